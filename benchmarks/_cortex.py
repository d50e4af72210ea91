"""Compile for a Cortex-M4F, and run in an emulator that counts instructions."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

HERE = Path(__file__).parent / "cortex_m4"
TOOLS = ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
COMPILER = [
    *("arm-none-eabi-gcc", "-std=c99", "-O2", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard"),
    *("-mfpu=fpv4-sp-d16", "-ffreestanding", "-fno-math-errno"),
]
EMULATOR = (
    "qemu-system-arm -M mps2-an386 -nographic -monitor none -serial none -icount shift=6,sleep=off "
    "-semihosting-config enable=on,target=native -kernel"
)


def missing_tools() -> list[str]:
    """What is not installed of what an emulated count needs."""
    return [tool for tool in TOOLS if shutil.which(tool) is None]


def run(command: list[str], folder: Path) -> str:
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{command[0]} failed: {done.stdout}{done.stderr}")
    return done.stdout or done.stderr  # the emulator says what the program says on stderr
