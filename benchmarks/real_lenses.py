"""Lenses of real cameras, from photographs of boards, against OpenCV's full model on the same ones.

::

    python -m benchmarks.real_lenses                         # those of ../shared/data/real
    python -m benchmarks.real_lenses --sets FOLDER:SIDE ...  # others; sides of squares in mm
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import MinorloopError

DATA = Path(__file__).parents[2] / "shared" / "data" / "real"
BOARDS = {"viking_left": 3.0, "davinci_left": 5.0}
"""Folders of pictures of calibration boards, and the sides of their squares in mm."""
_FOLDS = 3
_NEAR, _WITHIN, _LEFT_OUT = 0.005, 3.0, 1.1
"""Largest difference of focal lengths as a share, in deviations, and of residuals."""


def lens(sets: Sequence[str]) -> None:
    """Print the figures of each set of photographs."""
    chosen = [each.rpartition(":")[::2] for each in sets]
    for folder, side in chosen or [(DATA / name, side) for name, side in BOARDS.items()]:
        began = time.perf_counter()
        try:
            _lens_of(Path(folder), 1e-3 * float(side))
        except MinorloopError as error:
            print(f"{Path(folder).name}: refused: {error}")
        print(f"  {time.perf_counter() - began:.0f} s in all\n")


def _lens_of(folder: Path, side: float) -> None:
    from minorloop_head.procedures.calibrate import calibrate_lens
    from minorloop_head.procedures.target_pictures import ExpectedTarget, find_target, look_through

    pictures = look_through(folder, find_target(folder, ExpectedTarget(side)))
    fit = calibrate_lens(pictures)
    print(f"{folder.name}: {pictures.target}, {len(fit.seen)} of {_count(pictures)} pictures")
    print(f"  free: {fit.model}; rms {fit.rms:.3f} px, in pictures left out {fit.rms_left_out:.3f}")
    for sentence in fit.warnings:
        print(f"  warning: {sentence}")
    for how, corners in _corners_of_opencv(folder, pictures).items():
        matrix, _, rms = _full_model(corners, pictures.size)
        print(f"  against OpenCV, {how}, {len(corners)} pictures, rms {rms:.3f} px:")
        for k, each in enumerate(fit.measured[:2]):
            theirs = float(matrix[k, k])
            off = each.value - theirs
            share, sds = abs(off) / theirs, abs(off) / each.sd
            verdict = "met" if share <= _NEAR and sds <= _WITHIN else "short"
            print(
                f"    {each.name} {each.value:.2f} +- {each.sd:.2g} px, theirs {theirs:.2f}: "
                f"{share:.2%}, {sds:.2f} sd (<= {_NEAR:.1%}, <= {_WITHIN:g}: {verdict})"
            )
    ours, theirs = _left_out(fit.seen, pictures.size)
    verdict = "met" if ours <= _LEFT_OUT * theirs else "short"
    print(
        f"  {_FOLDS} folds left out in turn: {ours:.3f} px rms, OpenCV's full model {theirs:.3f}: "
        f"{ours / theirs:.3f} times (<= {_LEFT_OUT:g}: {verdict})"
    )


def _count(pictures: Any) -> int:
    return len(pictures.seen) + len(pictures.left_out)


def _corners_of_opencv(folder: Path, pictures: Any) -> dict[str, list[tuple[Any, Any]]]:
    """Return points and pixels of each picture: our corners, and for chessboards OpenCV's older."""
    import cv2

    found = {"same corners": [(each.points, each.pixels) for each in pictures.seen]}
    target = pictures.target
    if target.kind == "chessboard":
        inner = (target.columns - 1, target.rows - 1)
        points = target.square * np.stack(np.meshgrid(*map(np.arange, inner)), -1).reshape(-1, 2)
        older = []
        for path in sorted(folder.iterdir()):
            image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            good, pixels = (
                (False, None) if image is None else cv2.findChessboardCorners(image, inner)
            )
            if good:
                stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-3)
                pixels = cv2.cornerSubPix(image, pixels, (5, 5), (-1, -1), stop)
                older.append((points, pixels.reshape(-1, 2)))
        found["findChessboardCorners"] = older
    return found


def _full_model(corners: Sequence[tuple[Any, Any]], size: tuple[int, int]) -> Any:
    """Return matrix, distortion and rms of fx, fy, k1, k2, k3, p1, p2."""
    import cv2

    points = [np.column_stack([at, 0 * at[:, 0]]).astype(np.float32) for at, _ in corners]
    pixels = [np.asarray(each, np.float32) for _, each in corners]
    rms, matrix, distortion, *_ = cv2.calibrateCamera(points, pixels, size, None, None)  # type: ignore[call-overload]
    return matrix, distortion, rms


def _left_out(seen: Sequence[Any], size: tuple[int, int]) -> tuple[float, float]:
    """Return rms residuals of our and OpenCV's lens in pictures that were not used, in pixels."""
    from minorloop_head.vision.lens_calibration import as_opencv, fit_lens

    ours: list[FloatArray] = []
    theirs: list[FloatArray] = []
    for fold in range(_FOLDS):
        used = [each for number, each in enumerate(seen) if number % _FOLDS != fold]
        matrix, bent, _ = _full_model([(each.points, each.pixels) for each in used], size)
        own = as_opencv(fit_lens(used, size).lens)
        for each in seen[fold::_FOLDS]:
            ours.append(_residuals(each, *own))
            theirs.append(_residuals(each, matrix, bent))
    return tuple(  # type: ignore[return-value]
        float(np.sqrt((np.concatenate(each) ** 2).sum(axis=1).mean())) for each in (ours, theirs)
    )


def _residuals(seen: Any, matrix: FloatArray, distortion: FloatArray) -> FloatArray:
    """Return seen less projected corners (N, 2) at the best pose, in pixels."""
    import cv2

    points = np.column_stack([seen.points, 0 * seen.points[:, 0]])
    _, turn, place = cv2.solvePnP(points, seen.pixels, matrix, distortion, flags=cv2.SOLVEPNP_IPPE)
    turn, place = cv2.solvePnPRefineLM(points, seen.pixels, matrix, distortion, turn, place)
    pixels, _ = cv2.projectPoints(points, turn, place, matrix, distortion)
    return np.asarray(seen.pixels - pixels.reshape(-1, 2))


def main() -> None:
    """Print the figures of all sets that are there."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real_lenses", description=__doc__)
    parser.add_argument("--sets", nargs="+", default=[], help="other data than ../shared/data/real")
    chosen = parser.parse_args()
    if not DATA.is_dir() and not chosen.sets:
        print(f"SKIPPED: there is no folder {DATA}")
        return
    lens(chosen.sets)


if __name__ == "__main__":
    main()
