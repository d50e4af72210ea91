"""Cases of the command line: what each verb prints with ``--json``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from expected import inputs
from expected.case import Case, command, commands
from expected.models import texts

_COLUMNS = "--input voltage --output length"


def _identified() -> Any:
    inputs.record("run.csv")
    inputs.curves("curves.csv")
    inputs.relays("relays.csv")
    return commands(
        {
            "default": f"identify run.csv {_COLUMNS} --holdout 0.3",
            "time": f"identify run.csv {_COLUMNS} --time t --law 'lag=20 ms,levels=12'",
            "smoothed": f"identify run.csv {_COLUMNS} --law levels=12 --prior smooth",
            "plain": f"identify run.csv {_COLUMNS} --law levels=8,relay=unipolar "
            "--prior smooth:strength=0",
            "reversible": f"identify run.csv {_COLUMNS} --law levels=12,diagonal=reversible "
            "--law slope=yes",
            "adaptive": f"identify run.csv {_COLUMNS} --law levels=12,spacing=adaptive",
            "ridge": f"identify relays.csv {_COLUMNS} --law levels=24,lag=0 --record sd=0.002 "
            "--prior gaussian:mean=ridge",
            "signed": f"identify run.csv {_COLUMNS} --law levels=8,lag=0,signed=yes",
            "curves": f"identify curves.csv {_COLUMNS} --record curves=curve "
            "--record start_of_curve=positive",
        }
    )


def _timed() -> Any:
    t = np.arange(0, 40, 0.02)
    u = np.interp(t, np.linspace(0, 40, 21), inputs.walk(252, 1001)[::12])
    settled = inputs.backlash(u, np.linspace(0.02, 0.6, 12))
    y = np.zeros(t.size)
    for k in range(1, t.size):
        y[k] = y[k - 1] + 0.1 * (settled[k - 1] - y[k - 1])
    y += 0.001 * np.random.default_rng(1001).standard_normal(t.size)
    inputs.table("run.csv", "t [s],voltage [V],length [um]", t, u, y)
    return commands(
        {
            "dynamics": f"identify run.csv {_COLUMNS} --time t --law dynamics:levels=10",
            "creep": f"identify run.csv {_COLUMNS} --time t --law viscosity:creep=auto,levels=6",
        }
    )


def _used() -> Any:
    inputs.record("run.csv")
    command("identify run.csv --input voltage --output length --law levels=12,lag=0 --save m.json")
    inputs.table("targets.csv", "length [um]", np.array([0.1, -0.3, 0.25, 0.4, -5.0]))
    model = json.loads(Path("m.json").read_text())["model"]
    found = commands(
        {
            "invert": "invert m.json targets.csv --target length --clip",
            "refused": "invert m.json targets.csv --target length",
            "simulate": "simulate m.json run.csv --input voltage",
            "positive": "simulate m.json run.csv --input voltage --record start=positive",
            "c": "export c m.json --out c",
            "float32": "export c:float32=yes,memory=16,inverse=no m.json --out c32",
            "board": "head board m.json --out board",
        }
    )
    return {**found, "model": model, "code": texts(Path("c")), "code32": texts(Path("c32"))}


def _bench() -> Any:
    inputs.raw_log("log.csv")
    twin = "--actuator twin:ipmc,specimen=1000,noise=0.02,seed=3"
    plan = "--low -1.2 --high 1.2 --input 'voltage [V]'"
    inputs.table("targets.csv", "curvature [1/m]", np.array([2.0, -3.0, 1.0]))
    return commands(
        {
            "reduce": "reduce log.csv --input voltage --output length --time t",
            "decaying": f"plan decaying {plan} --levels 6 --save plan.csv",
            "reversal": f"plan reversal {plan} --levels 6",
            "staircase": f"plan staircase {plan} --levels 6",
            "sines": "plan sines:frequencies=0.2,1,amplitudes=0.7,1,preamble=-1.2,samples=40 "
            "--hold 5 --input 'voltage [V]' --save sines.csv",
            "run": f"run {twin} --plan plan.csv --store runs.sqlite",
            "resume": "resume --store runs.sqlite",
            "show": "runs show --store runs.sqlite",
            "list": "runs list --store runs.sqlite",
            "export": "runs export --store runs.sqlite",
            "identify": "identify runs.sqlite --law levels=6,diagonal=reversible --save m.json",
            "drive": f"drive m.json targets.csv --target curvature {twin} --store d.sqlite",
            "adaptive": f"run {twin} --plan adaptive:holds=6,levels=8 --store few.sqlite",
            "few": "identify few.sqlite",
            "swept": f"run {twin} --plan sines.csv --store sines.sqlite",
            "frequency": "frequency sines.sqlite --model m.json",
        }
    )


def _fleet() -> Any:
    for name, seed in (("a", 1000), ("b", 1001)):
        inputs.record(f"{name}.csv", samples=300, seed=seed)
    rows = "a,a.csv,voltage,length\nb,b.csv,voltage,length\nc,gone.csv,voltage,length\n"
    inputs.words("manifest.csv", f"specimen,file,input,output\n{rows}")
    return commands({"fleet": "fleet manifest.csv --out out --law levels=8 --workers 1"})


def _measured(file: str, columns: str) -> Case:
    line = f"identify {inputs.measured(file)} {columns}"
    return Case(
        f"measured_{file.partition('_')[0]}",
        lambda: commands({"default": line}),
        measured=(file,),
        bands=_ROUNDED,
    )


_HEAD = "--actuator twin:head --specimen 1000 --noise 0.05"


def _head() -> Any:
    inputs.table(
        "targets.csv", "pan [deg],tilt [deg]", np.array([10.0, 25.0]), np.array([5.0, 15.0])
    )
    return commands(
        {
            "identify": f"head identify {_HEAD} --store runs --head head.json",
            "drive": f"head drive targets.csv --head head.json {_HEAD}",
        }
    )


# A processor decides how sums are rounded, and by it where the search for a smoothness or lag ends.
_ROUNDED = {"*.effective_parameters": 1e-2, "*": 3e-4}
_NO_TIMES = ("*.time", "*.path", "*.store", "*.file", "*.out", "*.model")

CASES = (
    Case("identify", _identified, bands={"*": 1e-5}, left_out=_NO_TIMES),
    Case("identify_in_time", _timed, bands=_ROUNDED | {"*": 5e-3}, left_out=_NO_TIMES),
    Case("models_used", _used, bands={"*": 1e-7}, left_out=("code*.sha256",)),
    Case("bench", _bench, left_out=(*_NO_TIMES, "*.worst_sample")),
    Case("fleet", _fleet, left_out=_NO_TIMES),
    _measured(inputs.PIEZO, "--input input_V --output displacement_um --time t_s --holdout 0.3"),
    _measured(inputs.FERRITE, "--input H_A_per_m --output B_T --record groups=loop"),
    Case("head", _head, quick=False, left_out=_NO_TIMES),
)
