"""Functions of FMI of which an FMU for co-simulation without events and clocks has nothing."""

from __future__ import annotations

import re

_NUMBERS = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64", "Boolean", "String")
_FMI2 = """
GetBoolean(OF, fmi2Boolean values[])
GetString(OF, fmi2String values[])
SetInteger(OF, const fmi2Integer values[])
SetBoolean(OF, const fmi2Boolean values[])
SetString(OF, const fmi2String values[])
SetRealInputDerivatives(OF, const fmi2Integer order[], const fmi2Real values[])
GetRealOutputDerivatives(OF, const fmi2Integer order[], fmi2Real values[])
CancelStep(fmi2Component instance)
"""
_FMI3 = """
GetBinary(OF, size_t sizes[], fmi3Binary values[], size_t m)
SetBinary(OF, const size_t sizes[], const fmi3Binary values[], size_t m)
GetClock(OF, fmi3Clock values[])
SetClock(OF, const fmi3Clock values[])
SetInt32(OF, const fmi3Int32 values[], size_t m)
GetIntervalDecimal(OF, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
GetIntervalFraction(OF, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
GetShiftDecimal(OF, fmi3Float64 shifts[])
GetShiftFraction(OF, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
SetIntervalDecimal(OF, const fmi3Float64 intervals[])
SetIntervalFraction(OF, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
SetShiftDecimal(OF, const fmi3Float64 shifts[])
SetShiftFraction(OF, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
GetOutputDerivatives(OF, const fmi3Int32 orders[], fmi3Float64 values[], size_t m)
GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference of, size_t *count)
GetVariableDependencies(fmi3Instance instance, fmi3ValueReference of, size_t elements[], fmi3ValueReference on[],
                        size_t elements_on[], fmi3DependencyKind kinds[], size_t count)
GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n,
                     const fmi3ValueReference knowns[], size_t m, const fmi3Float64 seed[], size_t n_seed,
                     fmi3Float64 sensitivity[], size_t n_sensitivity)
EnterEventMode(fmi3Instance instance)
EnterConfigurationMode(fmi3Instance instance)
ExitConfigurationMode(fmi3Instance instance)
EvaluateDiscreteStates(fmi3Instance instance)
UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *update, fmi3Boolean *terminate, fmi3Boolean *nominals,
                     fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *next)
EnterContinuousTimeMode(fmi3Instance instance)
CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_way_back, fmi3Boolean *event, fmi3Boolean *terminate)
SetTime(fmi3Instance instance, fmi3Float64 time)
SetContinuousStates(fmi3Instance instance, const fmi3Float64 states[], size_t n)
GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[], size_t n)
GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t n)
GetContinuousStates(fmi3Instance instance, fmi3Float64 states[], size_t n)
GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t n)
GetNumberOfEventIndicators(fmi3Instance instance, size_t *count)
GetNumberOfContinuousStates(fmi3Instance instance, size_t *count)
EnterStepMode(fmi3Instance instance)
ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time)
"""
_FUNCTION = re.compile(r"^(\w+)\(([^)]*)\)$", re.MULTILINE)


def rest_of(fmi: str) -> str:
    """C of these functions of a version: reading or writing no variable is done, anything else is refused."""
    listed, handle = (_FMI2, "fmi2Component") if fmi == "2" else (_FMI3, "fmi3Instance")
    of = f"{handle} instance, const fmi{fmi}ValueReference vr[], size_t n"
    if fmi == "3":
        listed += "".join(f"Get{kind}(OF, fmi3{kind} values[], size_t m)\n" for kind in _NUMBERS)
        listed += "".join(f"Set{kind}(OF, const fmi3{kind} values[], size_t m)\n" for kind in _NUMBERS)
    found = []
    for name, given in _FUNCTION.findall(listed.replace("OF,", f"{of},")):
        arguments = " ".join(given.split())
        names = re.findall(r"(\w+)(?:\[\])?(?:,|$)", arguments)
        unused = "".join(f"  (void){one};\n" for one in names if one != "instance")
        done = f"  if (instance && n == 0) return fmi{fmi}OK;\n" if arguments.startswith(of) else ""
        found.append(
            f"FMI{fmi}(fmi{fmi}Status, fmi{fmi}{name})({arguments})\n{{\n{unused}{done}"
            f'  return fmi{fmi}_refused(instance, "{name}: this FMU has nothing of the kind");\n}}\n'
        )
    return "\n".join(found)
