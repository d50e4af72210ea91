"""Cracks in pictures of rough plates in unknown light: ``python -m benchmarks.plates score``.

The plates are drawn: a texture of noise, grains, pits, spots and streaks under uneven light, with
shadows, stains, painted stripes and straight joints, and with one or two dark wandering cracks of
1.5 to 8 pixels on every second one. ``score`` counts how many of the reported cracks are true (half
of the course within 6 pixels of a drawn one) and how many pictures with a crack get a true one, on
seeds that were not fitted on. ``fit`` fits and writes the odds of lines, as `benchmarks.cracks`
does for the wall of a pipe.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from benchmarks.crack_maps import CrackMap
from benchmarks.cracks import fit, lined
from minorloop.arrays import FloatArray
from minorloop_head.procedures.pictures import inspect_plate
from minorloop_head.vision.crack_evidence import PLATE_WEIGHTS
from minorloop_head.vision.cracks import PLATE_RADIUS, plate_levels
from minorloop_head.vision.imaging import opencv
from papers.catheter.detection import wilson
from papers.harness import Results

HEIGHT, WIDTH = 320, 480
"""Size of a picture, in pixels."""
PIXEL = 0.05e-3
"""Size of a pixel on the plate, in metres; it only scales what is reported."""
NEAR = 6.0
"""Pixels from a drawn course within which a place is on it."""
FIRST, COUNT = 20000, 400
"""First seed and number of the plates that the odds are fitted on."""


@dataclass(frozen=True, eq=False)
class Plate:
    """A picture of a plate and the courses of its cracks."""

    image: np.ndarray
    """Shape (height, width), of uint8."""
    courses: tuple[FloatArray, ...]
    """Each (N, 2): rows and columns, a pixel or less apart."""

    def share_on(self, pixels: FloatArray) -> float:
        """Return the share of the places (N, 2), columns and rows, that are on a crack."""
        if not self.courses:
            return 0.0
        off = cdist(pixels[:, ::-1], np.concatenate(self.courses)).min(axis=1)
        return float((off < NEAR).mean())


def draw_plate(seed: int) -> Plate:
    """Draw a plate by seed; even seeds have a crack."""
    rng = np.random.default_rng([seed, 5])
    grey = _texture(rng) * rng.uniform(6, 24) + rng.uniform(90, 160)
    grey += rng.normal(0, rng.uniform(1, 10), grey.shape)
    courses: list[FloatArray] = []
    if seed % 2 == 0:
        grey, courses = _cracked(grey, rng)
    grey = _lit(grey, rng)
    cv2 = opencv()
    sharp = cv2.GaussianBlur(grey, (0, 0), rng.uniform(0.3, 0.8))
    quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.uniform(75, 95))]
    _, coded = cv2.imencode(".jpg", np.clip(sharp, 0, 255).astype(np.uint8), quality)
    return Plate(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), tuple(courses))


def _noise(
    rng: np.random.Generator, slope: float, stretch: float = 1.0, heading: float = 0.0
) -> FloatArray:
    """Return noise (height, width) of variance 1 whose spectrum falls by a power of frequency."""
    v, u = np.fft.fftfreq(HEIGHT)[:, None], np.fft.rfftfreq(WIDTH)[None]
    c, s = math.cos(heading), math.sin(heading)
    size = np.hypot((c * u + s * v) * stretch, c * v - s * u)
    size[0, 0] = np.inf
    white = np.fft.rfft2(rng.normal(size=(HEIGHT, WIDTH)))
    found = np.fft.irfft2(white * size**-slope, (HEIGHT, WIDTH))
    return np.asarray(found / found.std())


def _grains(rng: np.random.Generator, size: float) -> tuple[FloatArray, FloatArray]:
    """Return the shade of each grain, and distances from borders between them over their size."""
    middles = rng.uniform(0, 1, (int(HEIGHT * WIDTH / size**2), 2)) * (HEIGHT, WIDTH)
    warp = 0.15 * size * np.stack([_noise(rng, 1.0), _noise(rng, 1.0)], axis=-1)
    places = np.stack(np.indices((HEIGHT, WIDTH)), axis=-1) + warp
    far, nearest = KDTree(middles).query(places, k=2)
    return rng.normal(size=len(middles))[nearest[..., 0]], (far[..., 1] - far[..., 0]) / size


def _texture(rng: np.random.Generator) -> FloatArray:
    """Return the texture (height, width) of a plate, of mean 0 and variance 1."""
    stretch = math.exp(rng.uniform(0, 2.3)) if rng.random() < 0.4 else 1.0
    found = rng.uniform(0.3, 1.5) * _noise(rng, rng.uniform(0.2, 1.3), stretch, rng.uniform(0, 3.2))
    if rng.random() < 0.7:
        shade, border = _grains(rng, math.exp(rng.uniform(math.log(2.5), math.log(32))))
        found += rng.uniform(0.2, 1.2) * shade
        found -= rng.uniform(0, 3.0) * np.exp(-border / rng.uniform(0.05, 0.25))
    for sign in (-1, 1):  # pits and spots
        if rng.random() < 0.5:
            high = np.clip(_noise(rng, 0.4) - rng.uniform(1.5, 2.6), 0, 1.5)
            found += sign * rng.uniform(0.5, 3) * high
    return np.asarray((found - found.mean()) / found.std())


def _course(rng: np.random.Generator) -> FloatArray:
    """Return a wandering course (N, 2) across the plate or along a part of this way."""
    ends = rng.uniform(0.1, 0.9, 2)
    if rng.random() < 0.5:
        course = np.array([[ends[0] * HEIGHT, 0], [ends[1] * HEIGHT, WIDTH - 1]])
    else:
        course = np.array([[0, ends[0] * WIDTH], [HEIGHT - 1, ends[1] * WIDTH]])
    rough = rng.uniform(0.12, 0.3)
    for level in range(9):
        way = np.diff(course, axis=0)
        across = np.stack([-way[:, 1], way[:, 0]], axis=1)
        middle = (course[1:] + course[:-1]) / 2
        middle += across * rng.normal(0, rough * 0.9**level, (len(way), 1))
        finer = np.empty((2 * len(course) - 1, 2))
        finer[::2], finer[1::2] = course, middle
        course = finer
    if rng.random() < 0.35:
        first = rng.uniform(0, 0.4)
        last = rng.uniform(first + 0.4, 1)
        course = course[int(first * len(course)) : int(last * len(course))]
    inside = ((course >= 0) & (course < (HEIGHT, WIDTH))).all(axis=1)
    return np.asarray(course[inside])


def _cracked(grey: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, list[FloatArray]]:
    """Return grey levels with one or two cracks, and their courses."""
    cv2, fine = opencv(), 4
    width, contrast = math.exp(rng.uniform(math.log(1.5), math.log(8))), rng.uniform(0.12, 0.5)
    dark, courses = np.zeros(grey.shape), []
    for _ in range(rng.integers(1, 3)):
        course = _course(rng)
        nodes = np.arange(0, len(course) + 40, 40)
        widths = np.interp(np.arange(len(course)), nodes, np.exp(rng.normal(0, 0.35, len(nodes))))
        drawn = np.zeros((fine * HEIGHT, fine * WIDTH), dtype=np.uint8)
        for start, stop, share in zip(course[:-1], course[1:], widths, strict=False):
            one, other = (
                tuple(np.rint(fine * end[::-1]).astype(int).tolist()) for end in (start, stop)
            )
            cv2.line(drawn, one, other, 255, max(round(fine * width * share), 1))
        cover = cv2.resize(drawn, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA) / 255
        dark = np.maximum(dark, cover * np.clip(0.75 + 0.35 * _noise(rng, 1.0), 0.05, 1.1))
        courses.append(course)
    return grey * (1 - contrast * cv2.GaussianBlur(dark, (0, 0), rng.uniform(0.4, 1.0))), courses


def _lit(grey: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return grey levels under uneven light, with shadow, stripe, joints and stains."""
    y, x = np.meshgrid(np.linspace(-1, 1, HEIGHT), np.linspace(-1, 1, WIDTH), indexing="ij")

    def beyond(wave: float) -> FloatArray:
        """Return the distance from a straight line over half the size, which wavers."""
        heading = rng.uniform(0, math.pi)
        line = math.cos(heading) * x + math.sin(heading) * y - rng.uniform(-0.6, 0.6)
        return np.asarray(line + wave * _noise(rng, 1.2))

    grey = grey * (1 + rng.uniform(-0.25, 0.25) * x + rng.uniform(-0.25, 0.25) * y)
    if rng.random() < 0.25:
        edge = beyond(0.02) / rng.uniform(0.005, 0.05)
        grey = grey * (1 - rng.uniform(0.2, 0.45) / (1 + np.exp(-np.clip(edge, -50, 50))))
    if rng.random() < 0.2:
        stripe = np.abs(beyond(0.0)) < rng.uniform(0.03, 0.2)
        grey = np.where(stripe, 0.6 * grey + rng.choice([-30, 100]), grey)
    for _ in range(rng.integers(1, 4) if rng.random() < 0.25 else 0):
        joint = np.exp(-0.5 * (beyond(0.002) / rng.uniform(0.004, 0.015)) ** 2)
        grey = grey * (1 - rng.uniform(0.1, 0.5) * joint)
    for _ in range(rng.integers(1, 4) if rng.random() < 0.3 else 0):
        size, flat = rng.uniform(4, 40), rng.uniform(0.5, 2)
        off = np.hypot(
            flat * (x - rng.uniform(-1, 1)) * WIDTH / 2, (y - rng.uniform(-1, 1)) * HEIGHT / 2
        )
        edge = (off + 0.2 * size * _noise(rng, 1.2) - size) / rng.uniform(1, 6)
        grey = grey * (1 - rng.uniform(0.1, 0.4) / (1 + np.exp(np.clip(edge, -50, 50))))
    return np.asarray(grey)


def map_of(plate: Plate, seed: int) -> CrackMap:
    """Return a plate as a map on which odds are fitted."""
    stack, window = plate_levels(plate.image)
    course = np.concatenate([np.empty((0, 2)), *plate.courses])
    places = window.place(course[:, 1], course[:, 0], PLATE_RADIUS)
    # fit() tells halves by seed // 2: each needs plates with and without a crack.
    return CrackMap("plate", seed, stack, window, PLATE_RADIUS, (), places, Results())


def score(first: int, count: int) -> None:
    """Print the share of true cracks among those reported, and that of pictures that get one."""
    counts: Counter[str] = Counter()
    for seed in range(first, first + count):
        plate = draw_plate(seed)
        found = inspect_plate(plate.image, PIXEL).findings
        true = sum(plate.share_on(each.outline) >= 0.5 for each in found)
        kind = "cracked" if plate.courses else "bare"
        counts.update({"reported": len(found), "true": true, kind: 1})
        counts.update({f"{kind} with a true one": true > 0, f"{kind} with any": len(found) > 0})
    for name, hits, of in (
        ("reported cracks that are true", "true", "reported"),
        ("pictures with a crack that get one", "cracked with a true one", "cracked"),
        ("pictures without a crack that get one", "bare with any", "bare"),
    ):
        low, high = wilson(counts[hits], max(counts[of], 1))
        share = counts[hits] / max(counts[of], 1)
        print(f"{name}: {share:.3f} of {counts[of]} ({max(low, 0.0):.2f} to {high:.2f})")


def main() -> None:
    """Draw plates, fit or score, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("fit", "score"))
    parser.add_argument("--first", type=int)
    parser.add_argument("--count", type=int)
    options = parser.parse_args()
    if options.what == "score":
        score(options.first or 0, options.count or 100)
        return
    first, count = options.first or FIRST, options.count or COUNT
    odds = fit(lined([map_of(draw_plate(seed), seed) for seed in range(first, first + count)]))
    odds.save(PLATE_WEIGHTS)
    print(f"{len(odds.first)} trees on {count} plates")


if __name__ == "__main__":
    main()
