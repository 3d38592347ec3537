"""Functional mock-up units as instances of fmpy, with variables by name."""

from __future__ import annotations

import ctypes

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave
from fmpy.logging import addLoggerProxy

_LOGGERS = []
"""All of FMI 2.0: the proxy of fmpy calls the last one, whatever instance logs."""


class Instance:
    """A unit that is instantiated, with its variables by name and what it logs."""

    def __init__(self, unit, *, begin=True, log=False):
        described = fmpy.read_model_description(str(unit.file))
        self.number = {v.name: v.valueReference for v in described.modelVariables}
        self.said = []
        kind = FMU2Slave if unit.fmi == "2" else FMU3Slave
        self.fmu = kind(
            guid=described.guid,
            unzipDirectory=str(unit.file.with_suffix("")),
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName="one",
        )
        self.fmi = unit.fmi
        if unit.fmi == "2":
            calls = fmi2CallbackFunctions()
            calls.logger = fmi2CallbackLoggerTYPE(
                lambda e, name, status, category, text: self.said.append(text.decode())
            )
            addLoggerProxy(ctypes.byref(calls))
            _LOGGERS.append(calls)
            self.fmu.instantiate(callbacks=calls, loggingOn=log)
            self.fmu.setupExperiment(startTime=0.0)
        else:
            self.fmu.instantiate(
                loggingOn=log, logMessage=lambda e, status, category, text: self.said.append(text.decode())
            )
        if begin:
            self.begin()

    def begin(self):
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def names(self, start):
        return [name for name in self.number if name.startswith(start)]

    def get(self, *starts):
        numbers = [self.number[name] for start in starts for name in self.names(start)]
        return np.array(self.fmu.getReal(numbers) if self.fmi == "2" else self.fmu.getFloat64(numbers))

    def count(self, name):
        numbers = [self.number[name]]
        return (self.fmu.getInteger(numbers) if self.fmi == "2" else self.fmu.getInt32(numbers))[0]

    def set(self, start, values):
        numbers = [self.number[name] for name in self.names(start)]
        values = [float(v) for v in np.ravel(values)]
        assert len(numbers) == len(values)
        self.fmu.setReal(numbers, values) if self.fmi == "2" else self.fmu.setFloat64(numbers, values)

    def step(self, t, h):
        self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=h)

    def saved(self):
        return self.fmu.getFMUstate() if self.fmi == "2" else self.fmu.getFMUState()

    def restore(self, state):
        self.fmu.setFMUstate(state) if self.fmi == "2" else self.fmu.setFMUState(state)

    def packed(self, state):
        return self.fmu.serializeFMUstate(state) if self.fmi == "2" else self.fmu.serializeFMUState(state)

    def unpacked(self, data):
        return self.fmu.deSerializeFMUstate(data) if self.fmi == "2" else self.fmu.deserializeFMUState(data)
