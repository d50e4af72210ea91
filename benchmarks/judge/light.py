"""Radiance of a scene under each of its lights, by path tracing with Mitsuba 3.

Each LED is a small disc that faces ahead. At every point of a path the light of each of them is
sampled, so that one path serves all: the images of several lights are sums, as light is.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from benchmarks.judge import surface
from benchmarks.judge.scenes import HEIGHT, METALS, THICKNESS, WIDTH, Scene

LED_RADIUS = 0.2
"""Of the emitting surface of a chip LED, in mm."""
PUPIL, BLUR = 0.2, 0.5
"""Diameter of the entrance pupil in mm, and standard deviation of the blur in focus in pixels."""
BOUNCES = 3
"""Surfaces on a path. """
_CLAMP = 2.0
"""Most light of one indirect path, over the mean of the direct light: rarer, brighter ones would
be single bright pixels."""
_LIBRARIES = ("libLLVM.so.19.1", "libLLVM-19.so.1", "libLLVM-18.so.1", "libLLVM-17.so.1")


def prepare() -> None:
    """Choose the variant that compiles to the processor; needs LLVM 17 or newer."""
    if "DRJIT_LIBLLVM_PATH" not in os.environ:
        found = [p for name in _LIBRARIES for p in sorted(Path("/usr/lib").glob(f"*/{name}"))]
        if found:
            os.environ["DRJIT_LIBLLVM_PATH"] = str(found[0])
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_mono")
    dr.set_thread_count(1)  # several threads gain little here, and others use the machine


def mesh(part: surface.Triangles, bsdf: object | None, name: str) -> object:
    """Return triangles as a shape."""
    import mitsuba as mi

    properties = mi.Properties()
    if bsdf is not None:
        properties["bsdf"] = bsdf
    shape = mi.Mesh(name, len(part.points), len(part.corners), properties, True, True)
    values = mi.traverse(shape)
    values["vertex_positions"] = part.points.astype(np.float32).ravel()
    values["vertex_normals"] = part.normals.astype(np.float32).ravel()
    values["vertex_texcoords"] = part.uv.astype(np.float32).ravel()
    values["faces"] = part.corners.astype(np.uint32).ravel()
    values.update()
    return shape


def _map(values: np.ndarray, high: float | None = None) -> dict[str, object]:
    import mitsuba as mi

    values = values if high is None else np.minimum(values, high)
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(values[..., None], dtype=np.float32)),
        "raw": True,
        "wrap_mode": "mirror",
    }


def _metal(scene: Scene, alphas: tuple[object, object], shine: object) -> dict[str, object]:
    eta, k = METALS[scene.metal]
    return {
        "type": "roughconductor",
        "distribution": "ggx",
        "eta": eta,
        "k": k,
        "alpha_u": alphas[0],
        "alpha_v": alphas[1],
        "specular_reflectance": shine,
    }


def build(scene: Scene) -> object:
    """Return the scene for Mitsuba."""
    import mitsuba as mi

    maps = surface.textures(scene)
    alphas = tuple(_map(a * maps.rough, 0.9) for a in scene.alphas)
    layered = {
        "type": "blendbsdf",
        "weight": _map(maps.cover),
        "metal": _metal(scene, alphas, _map(maps.shine, 1.0)),
        "layer": {"type": "diffuse", "reflectance": _map(maps.layer)},
    }
    skin = {"type": "bumpmap", "height": _map(maps.height), "bsdf": layered}
    wall = mi.load_dict({"type": "twosided", "skin": skin})
    parts = {"type": "scene", "wall": mesh(surface.wall_triangles(scene), wall, "wall")}
    if scene.hole is not None:
        _add_hole(scene, parts)
    if scene.groove is not None:
        parts["groove"] = mesh(surface.groove_triangles(scene), wall, "groove")
    for n, bead in enumerate(scene.beads):
        sunk = 10.0 + bead.radius - bead.height
        place = [sunk * np.cos(bead.phi), sunk * np.sin(bead.phi), bead.z]
        skin = (
            {"type": "diffuse", "reflectance": 0.12}
            if bead.soiled
            else _metal(scene, (bead.alpha, bead.alpha), 0.9)
        )
        parts[f"bead{n}"] = {"type": "sphere", "center": place, "radius": bead.radius, "bsdf": skin}
    return mi.load_dict(parts)


def _add_hole(scene: Scene, parts: dict[str, object]) -> None:
    import mitsuba as mi

    hole = scene.hole
    alpha = max(scene.alphas) * 1.2
    skin = _metal(scene, (alpha, alpha), 0.8)
    if hole.inside == "bright":
        skin = {"type": "diffuse", "reflectance": hole.albedo}
    lining = mi.load_dict({"type": "twosided", "skin": skin})
    for n, part in enumerate(surface.bore_triangles(hole)):
        parts[f"bore{n}"] = mesh(part, lining, f"bore{n}")
    if hole.inside in ("soil", "bright"):
        skin = {"type": "diffuse", "reflectance": hole.albedo}
        soil = mi.load_dict({"type": "twosided", "skin": skin})
        rng = np.random.default_rng([scene.texture_seed, 6])
        parts["soil"] = mesh(surface.soil_triangles(hole, rng), soil, "soil")
    if hole.inside == "backlit":
        axis = np.array([np.cos(hole.phi), np.sin(hole.phi), 0.0])
        far = (10.0 + THICKNESS + 0.5) * axis + [0.0, 0.0, hole.z]
        parts["behind"] = {
            "type": "disk",
            "to_world": mi.ScalarTransform4f()
            .look_at(origin=far.tolist(), target=(far - axis).tolist(), up=[0, 0, 1])
            .scale(2.5),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": 1.0},
        }


def radiance(scene: Scene, samples: int, seed: int = 0) -> np.ndarray:
    """Return the light (4, HEIGHT, WIDTH) of each LED, and from behind for light 1.

    Parameters
    ----------
    scene : Scene
    samples : int
        Paths through a pixel.
    seed : int
        Of the paths.
    """
    import drjit as dr

    world = build(scene)
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    rng = np.random.default_rng([scene.seed, seed, 9])
    direct, indirect = np.zeros((2, 4, len(pixels)))
    for _ in range(samples):
        first, later = _paths(world, scene, pixels, rng, int(rng.integers(2**31)))
        direct += first
        limit = _CLAMP * first[:3].mean()
        indirect += np.minimum(later, limit)
    dr.flush_malloc_cache()
    return ((direct + indirect) / samples).reshape(4, HEIGHT, WIDTH)


def _constant(kind: type, values: np.ndarray) -> object:
    """Return a vector that is data of a kernel, so that all scenes share the kernel."""
    import drjit as dr
    import mitsuba as mi

    return kind(*(dr.opaque(mi.Float, float(value)) for value in values))


def _paths(
    world: object, scene: Scene, pixels: np.ndarray, rng: np.random.Generator, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the direct and the indirect light (4, N) of one path through each pixel."""
    import drjit as dr
    import mitsuba as mi

    count = len(pixels)
    way = scene.rays(pixels + BLUR * rng.standard_normal(pixels.shape))
    pupil = 0.5 * PUPIL * np.sqrt(rng.random(count))
    turn = 2 * np.pi * rng.random(count)
    start = np.stack([pupil * np.cos(turn), pupil * np.sin(turn), 0 * turn], axis=1)
    way = (scene.focus * way - start) @ scene.rotation.T
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    start = start @ scene.rotation.T + scene.lens
    ray = mi.Ray3f(mi.Point3f(start.T.astype(np.float32)), mi.Vector3f(way.T.astype(np.float32)))
    leds = scene.leds @ scene.rotation.T + scene.lens
    side, up, ahead = (_constant(mi.Vector3f, r) for r in scene.rotation.T)
    places = [_constant(mi.Point3f, value) for value in leds]
    light = dr.opaque(mi.Float, scene.hole.light if scene.hole is not None else 0.0)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    context = mi.BSDFContext()
    share, active = mi.Float(1.0), mi.Mask(True)
    direct, indirect = ([mi.Float(0.0) for _ in range(4)] for _ in range(2))
    for bounce in range(BOUNCES):
        si = world.ray_intersect(ray, active)
        active &= si.is_valid()
        total = indirect if bounce else direct
        behind = si.emitter(world) != None  # noqa: E711
        total[3] += dr.select(active & behind, light * share, 0.0)
        active &= ~behind
        bsdf = si.bsdf(ray)
        # The first surface is lit by each LED, the others by one that is drawn for each path.
        which = mi.UInt32(dr.minimum(3.0 * sampler.next_1d(active), 2.0))
        some = places
        if bounce:
            some = [dr.select(which == 0, places[0], dr.select(which == 1, places[1], places[2]))]
        for n, led in enumerate(some):
            disc = mi.warp.square_to_uniform_disk_concentric(sampler.next_2d(active))
            point = led + LED_RADIUS * (disc.x * side + disc.y * up)
            to = point - si.p
            far = dr.norm(to)
            to /= far
            emitted = dr.maximum(-dr.dot(to, ahead), 0.0)
            lit = active & (emitted > 0.0) & ~world.ray_test(si.spawn_ray_to(point), active)
            value = bsdf.eval(context, si, si.to_local(to), lit)[0]
            sent = dr.select(lit, share * value * emitted / (far * far), 0.0)
            if bounce == 0:
                total[n] += sent
            else:
                for k in range(3):
                    total[k] += dr.select(which == k, 3.0 * sent, 0.0)
        if bounce == BOUNCES - 1:
            break
        one, two = sampler.next_1d(active), sampler.next_2d(active)
        bs, weight = bsdf.sample(context, si, one, two, active)
        share = dr.select(active, share * weight[0], 0.0)
        active &= share > 0.0
        ray = si.spawn_ray(si.to_world(bs.wo))
    found, total = direct, indirect
    dr.eval(found, total)
    strengths = np.array([*scene.strengths, 1.0])[:, None] * 100.0
    strengths[3] = 1.0
    return tuple(strengths * np.array([np.array(k) for k in part]) for part in (found, total))
