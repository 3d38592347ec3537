"""Writing a package."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from continuum_grasp import __version__
from continuum_grasp.errors import InputError
from continuum_grasp.export.check_program import check_source, vectors_source
from continuum_grasp.export.header import abi_of, calls_of, header
from continuum_grasp.export.layer import internal_header, kernels_source, layer_source
from continuum_grasp.export.parts import PARTS
from continuum_grasp.export.reals import real_of
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill
from continuum_grasp.export.vectors import vectors_of
from continuum_grasp.model import FingerModel

def export_c(model, folder, real="double", what=("dynamics","step","kinematics","statics"), prefix="finger", target="host", ranges=None, step=None, substeps=1):
    r=real_of(real)
    subject=Subject.of(model,prefix,r,ranges or {},step,substeps)
    parts=[PARTS[n](subject) for n in what]
    words={"p":prefix,"P":prefix.upper(),"version":__version__,"real":real,"title":"t","abi":abi_of(subject,parts),"hash":"x"}
    folder=Path(folder)
    vs=[vectors_of(subject,c,k) for k,c in enumerate(calls_of(parts))]
    words["count"]=str(len(vs))
    fs={f"include/{prefix}.h":header(subject,parts,words),
     f"src/{prefix}_internal.h":internal_header(subject,parts,words),
     f"src/{prefix}_kernels.c":kernels_source(subject,parts,words),
     f"src/{prefix}.c":layer_source(subject,parts,words),
     "tests/vectors.h":vectors_source(subject,vs,words),
     "tests/check.c":check_source(subject,vs,words),
     "tests/check.h":fill("tests/check.h",words),
     "tests/main.c":fill("tests/main.c",words)}
    for n,t in fs.items():
        (folder/n).parent.mkdir(parents=True,exist_ok=True); (folder/n).write_text(t)
    return subject,vs
class Package: pass
