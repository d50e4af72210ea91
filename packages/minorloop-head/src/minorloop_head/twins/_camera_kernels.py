"""Compiled loops for the camera: arrays in, arrays out.

Rays meet the wall exactly at nodes every ``CELL`` pixels; ``fields`` (F, V, U) float32 holds the
smooth quantities there, which are linear between nodes along a row of pixels:

0 phi, 1 z, 2 width of a pixel on the wall, 3 variance of the blur in square pixels,
4 light by way of the other walls, 5 and 6 slopes of the ray into the wall around and along,
and then six for each LED that is on: irradiance along the normal, around and along the pipe,
slopes around and along at which the wall mirrors the LED, weight of that reflection.

Lengths are in metres; irradiance is that at 10 mm, squarely, for 1.
"""

from __future__ import annotations

import numpy as np
from numba import njit

CELL = 8
"""Pixels between nodes: exact rays at each pixel would take 64 times as many. By trial."""
COMMON, PER_LED = 7, 6
"""Fields at a node without the LEDs, and for each LED that is on."""

_F = np.float32
_ZERO, _HALF, _ONE = _F(0.0), _F(0.5), _F(1.0)
_NEAR = 1e-4  # square of 10 mm
_STEPS = 24
"""Steps of the integral of the light scattered along a ray, by trial: twice as many change it by
1 %."""
_FARTHEST = 0.15
"""Longest ray in metres, for those along the axis: at this distance an LED gives less than 0.5 % of
its irradiance at 10 mm."""


@njit(cache=True, nogil=True)
def fill_nodes(rays, rotations, positions, radius, leds, strengths, optics, extinction, fields):
    """Intersect the rays of the nodes with the wall.

    ``rays`` (V, U, 3) in the camera, ``rotations`` (V, 3, 3) and ``positions`` (V, 3) of each row
    of nodes, ``leds`` (N, 3) in the camera, ``optics`` (focal length in pixels, aperture, distance
    in focus, least variance). Light decays by ``extinction`` in 1/m from the LED to the lens.
    """
    focal, aperture, focus, sharpest = optics
    for i in range(rays.shape[0]):
        turn, lens = rotations[i], positions[i]
        inside = lens[0] ** 2 + lens[1] ** 2 - radius**2
        sources = np.empty((leds.shape[0], 3))
        for k in range(leds.shape[0]):
            for a in range(3):
                sources[k, a] = lens[a]
                for b in range(3):
                    sources[k, a] += turn[a, b] * leds[k, b]
        for j in range(rays.shape[1]):
            x, y, one = rays[i, j]
            norm = np.sqrt(x * x + y * y + one * one)
            dx = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * one) / norm
            dy = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * one) / norm
            dz = (turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * one) / norm
            flat, along = dx * dx + dy * dy, lens[0] * dx + lens[1] * dy
            length = min(
                -inside / (along + np.sqrt(along * along - flat * inside) + 1e-9), _FARTHEST
            )
            wx, wy, wz = lens[0] + length * dx, lens[1] + length * dy, lens[2] + length * dz
            away = max(np.sqrt(wx * wx + wy * wy), 1e-4)
            nx, ny = -wx / away, -wy / away
            tx, ty = ny, -nx
            facing = max(-(dx * nx + dy * ny), 0.03)
            depth = length / norm
            circle = focal * aperture * abs(1.0 / depth - 1.0 / focus)
            fields[0, i, j] = np.arctan2(wy, wx)
            fields[1, i, j] = wz
            fields[2, i, j] = length / focal / facing**0.5
            fields[3, i, j] = sharpest + circle * circle / 16.0
            around = 0.0
            fields[5, i, j] = (dx * tx + dy * ty) / facing
            fields[6, i, j] = dz / facing
            for k in range(leds.shape[0]):
                lx, ly, lz = sources[k, 0] - wx, sources[k, 1] - wy, sources[k, 2] - wz
                far = np.sqrt(lx * lx + ly * ly + lz * lz)
                lx, ly, lz = lx / far, ly / far, lz / far
                ahead = -(lx * turn[0, 2] + ly * turn[1, 2] + lz * turn[2, 2])
                power = strengths[k] * max(ahead, 0.0) * _NEAR / far**2
                if extinction > 0.0:
                    power *= np.exp(-extinction * (far + length))
                hx, hy, hz = lx - dx, ly - dy, lz - dz
                up = max(hx * nx + hy * ny, 0.05)
                p, q = (hx * tx + hy * ty) / up, hz / up
                face = lx * nx + ly * ny
                around += power * far**2 / (far**2 + radius**2)
                first = COMMON + PER_LED * k
                fields[first, i, j] = power * max(face, 0.0)
                fields[first + 1, i, j] = power * (lx * tx + ly * ty)
                fields[first + 2, i, j] = power * lz
                fields[first + 3, i, j] = p
                fields[first + 4, i, j] = q
                square = min((1.0 + p * p + q * q) ** 2, 20.0)
                lit = min(max(face * 20.0, 0.0), 1.0)
                fields[first + 5, i, j] = power * lit * square / (4.0 * facing)
            fields[4, i, j] = around


@njit(cache=True, nogil=True)
def backscatter(rays, rotations, positions, radius, leds, strengths, water, out):
    """Fill out (V, U) with the light that water scatters back along each ray.

    ``water`` is (extinction in 1/m, backscatter in 1/(m sr)); the rest as in ``fill_nodes``.
    Light that is scattered twice is left out. The integral has _STEPS steps.
    """
    extinction, back = water
    source = np.empty(3)
    for i in range(rays.shape[0]):
        turn, lens = rotations[i], positions[i]
        inside = lens[0] ** 2 + lens[1] ** 2 - radius**2
        for j in range(rays.shape[1]):
            way = turn @ rays[i, j]
            way /= np.sqrt((way**2).sum())
            flat, along = way[0] ** 2 + way[1] ** 2, lens[0] * way[0] + lens[1] * way[1]
            length = -inside / (along + np.sqrt(along * along - flat * inside) + 1e-9)
            step = min(length, _FARTHEST) / _STEPS
            total = 0.0
            for k in range(leds.shape[0]):
                source[:] = turn @ leds[k]
                for n in range(_STEPS):
                    r = (n + 0.5) * step
                    to = r * way - source
                    far = np.sqrt((to**2).sum())
                    ahead = (to[0] * turn[0, 2] + to[1] * turn[1, 2] + to[2] * turn[2, 2]) / far
                    power = strengths[k] * max(ahead, 0.0) * _NEAR / far**2
                    total += power * np.exp(-extinction * (far + r)) * step
            # The unit is the radiance of a dull white wall of irradiance 1, which is 1 / pi.
            out[i, j] = np.pi * back * total


@njit(cache=True, nogil=True, fastmath=True)
def unwrapped(fields, i, j):
    """Return phi at the corners of a cell without jumps: upper left, right, lower left, right."""
    turn = _F(2 * np.pi)
    a, b = fields[0, i, j], fields[0, i, j + 1]
    c, d = fields[0, i + 1, j], fields[0, i + 1, j + 1]
    b += turn * np.rint((a - b) / turn)
    c += turn * np.rint((a - c) / turn)
    d += turn * np.rint((a - d) / turn)
    return a, b, c, d


@njit(cache=True, nogil=True)
def _place_at(fields, v, u, slope):
    """Return phi and z of one pixel; fill slope (2, 2) with their slopes over u and v."""
    i, j = v // CELL, u // CELL
    sv, su = (v % CELL) / CELL, (u % CELL) / CELL
    a, b, c, d = unwrapped(fields, i, j)
    phi = (1 - sv) * ((1 - su) * a + su * b) + sv * ((1 - su) * c + su * d)
    slope[0, 0] = ((1 - sv) * (b - a) + sv * (d - c)) / CELL
    slope[0, 1] = ((1 - su) * (c - a) + su * (d - b)) / CELL
    a, b = fields[1, i, j], fields[1, i, j + 1]
    c, d = fields[1, i + 1, j], fields[1, i + 1, j + 1]
    slope[1, 0] = ((1 - sv) * (b - a) + sv * (d - c)) / CELL
    slope[1, 1] = ((1 - su) * (c - a) + su * (d - b)) / CELL
    return phi, (1 - sv) * ((1 - su) * a + su * b) + sv * ((1 - su) * c + su * d)


@njit(cache=True, nogil=True)
def _light_at(fields, v, u, out):
    """Fill out (F,) with the other fields at one pixel."""
    i, j = v // CELL, u // CELL
    sv, su = (v % CELL) / CELL, (u % CELL) / CELL
    for f in range(2, fields.shape[0]):
        a, b = fields[f, i, j], fields[f, i, j + 1]
        c, d = fields[f, i + 1, j], fields[f, i + 1, j + 1]
        out[f] = (1 - sv) * ((1 - su) * a + su * b) + sv * ((1 - su) * c + su * d)


@njit(cache=True, nogil=True)
def _pixel_size(radius, slope, x, y, off):
    """Return the width of a pixel on the wall in the direction (x, y), of length off."""
    step_u = (radius * slope[0, 0] * x + slope[1, 0] * y) / off
    step_v = (radius * slope[0, 1] * x + slope[1, 1] * y) / off
    return np.sqrt(step_u * step_u + step_v * step_v) + 1e-12


@njit(cache=True, nogil=True)
def _turned(angle):
    """Return an angle wrapped to half a turn about 0."""
    return angle - 2 * np.pi * np.rint(angle / (2 * np.pi))


@njit(cache=True, nogil=True)
def _tilted(now, a, b, albedo, metal):
    """Return the radiance of metal with slopes a and b."""
    out = metal[0] * metal[4] * albedo * now[4]
    for first in range(COMMON, now.size, PER_LED):
        out += _lit(now, first, a, b, albedo, metal)
    return out


@njit(cache=True, nogil=True)
def _lit(now, first, a, b, albedo, metal):
    """Return the radiance of metal with slopes a and b by one LED, whose fields begin at first."""
    face = max(now[first] - a * now[first + 1] - b * now[first + 2], 0.0)
    s, t = (now[first + 3] + a) / metal[2], (now[first + 4] + b) / metal[3]
    wide = 1.0 + s * s + t * t
    gloss = metal[1] / (np.pi * metal[2] * metal[3]) * now[first + 5] / (wide * wide)
    return metal[0] * albedo * face / np.sqrt(1.0 + a * a + b * b) + gloss


@njit(cache=True, nogil=True)
def _in_bore(now, x, y, mouth, depth, lining, kind, brightness, metal):
    """Return the radiance seen in a mouth at (x, y) from its centre."""
    if kind == 2:
        light = metal[4] * now[4]
        for first in range(COMMON, now.size, PER_LED):
            light += now[first]
        return metal[0] * brightness * light
    wx, wy = now[5], now[6]
    speed = wx * wx + wy * wy + 1e-12
    part = x * wx + y * wy
    reach = (-part + np.sqrt(max(part * part + speed * (mouth**2 - x * x - y * y), 0.0))) / speed
    down = min(reach, depth)
    px, py = x + down * wx, y + down * wy
    at_side = reach < depth
    out = 0.0
    for first in range(COMMON, now.size, PER_LED):
        face = now[first]
        if face <= 0.0:
            continue
        lx, ly = px + down * now[first + 1] / face, py + down * now[first + 2] / face
        edge = (mouth - np.sqrt(lx * lx + ly * ly)) / (0.04 * mouth)
        lit = min(max(0.5 + edge, 0.0), 1.0)
        if at_side:
            cosine = max(-(px * now[first + 1] + py * now[first + 2]) / mouth, 0.0)
            out += lining * lit * cosine
        else:
            out += brightness * lit * face
    if at_side:
        out += 0.3 * lining * metal[4] * now[4] * np.exp(-down / mouth)
    else:
        out += brightness * 0.3 * metal[4] * now[4]
    return metal[0] * out


@njit(cache=True, nogil=True)
def add_bore(fields, radius, bore, box, metal, radiance):
    """Draw a bore over the image, its edges weighted by their coverage of a pixel.

    ``bore`` is (phi, z, radius of the mouth, depth to the floor or to the exit, kind: 0 pit or
    1 hole or 2 deposit, brightness, chamfer, slope of the chamfer, lining, light from behind),
    ``box`` the pixels (first row, end, first column, end) that may see it.
    """
    phi0, z0, mouth, depth, kind, brightness, chamfer, incline, lining, behind = bore
    now, slope = np.empty(fields.shape[0]), np.empty((2, 2))
    for v in range(box[0], box[1]):
        for u in range(box[2], box[3]):
            phi, z = _place_at(fields, v, u, slope)
            x, y = radius * _turned(phi - phi0), z - z0
            off = np.sqrt(x * x + y * y) + 1e-12
            pixel = _pixel_size(radius, slope, x, y, off)
            outer = min(max(0.5 + (mouth + chamfer - off) / pixel, 0.0), 1.0)
            if outer == 0.0:
                continue
            _light_at(fields, v, u, now)
            inner = min(max(0.5 + (mouth - off) / pixel, 0.0), 1.0)
            value = (1.0 - outer) * radiance[v, u]
            if outer > inner:
                a, b = incline * x / off, incline * y / off
                value += (outer - inner) * _tilted(now, a, b, 1.0, metal)
            if inner > 0.0:
                value += inner * (
                    _in_bore(now, x, y, mouth, depth, lining, kind, brightness, metal) + behind
                )
            radiance[v, u] = value


@njit(cache=True, nogil=True)
def _in_groove(now, middle, pixel, half, x, y, slope, albedo, metal):
    """Return the mean radiance of the part of a pixel that is in a groove with a V for its section.

    ``middle`` is the place of a pixel of a width ``pixel`` across the groove, ``half`` half of its
    width, (x, y) the unit vector across, ``slope`` that of both flanks. A ray that enters at X is
    at X + w d at the depth d; a flank hides the other if its slope is steeper than the ray, and
    shadows it if it is steeper than the light. Light from one flank to the other is reflected
    once, in proportion to the share of its view that the other fills.
    """
    view = 1.0 - 1.0 / np.sqrt(1.0 + slope * slope)
    again = view * (metal[0] + metal[1]) ** 2 / np.sqrt(1.0 + slope * slope)
    total, seen = 0.0, 1e-12
    for side in (-1.0, 1.0):
        w, a, b = side * (now[5] * x + now[6] * y), side * slope * x, side * slope * y
        low = max(side * middle - 0.5 * pixel, min(max(-w * slope, -1.0), 1.0) * half)
        high = min(side * middle + 0.5 * pixel, half)
        if high <= low:
            continue
        seen += high - low
        total += (high - low) * metal[0] * metal[4] * albedo * now[4] * (1.0 - view)
        for first in range(COMMON, now.size, PER_LED):
            if now[first] <= 0.0:
                continue
            steep = slope * side * (now[first + 1] * x + now[first + 2] * y) / now[first]
            dark = half * max((-steep - 1.0) / (1.0 - steep), 0.0) if steep < 0.0 else 0.0
            dark -= w * slope * (half - dark)  # where it is seen
            if steep < 1.0 and high > dark:
                total += (high - max(low, dark)) * _lit(now, first, a, b, albedo, metal)
            if steep > -1.0:
                other = min(2.0 / (1.0 + max(steep, 1.0)), 1.0)  # share of it that is lit
                face = now[first] * (1.0 + steep)
                total += (high - low) * again * albedo * other * face
    return total / seen


@njit(cache=True, nogil=True)
def add_crack(fields, radius, corners, look, box, metal, radiance):
    """Draw a crack over the image; ``corners`` is (N, 3): phi, z, half the width.

    ``look`` is (albedo, slope of its flanks, or 0 for a dull filling).
    """
    now, slope = np.empty(fields.shape[0]), np.empty((2, 2))
    middle_z = 0.5 * (corners[:, 1].min() + corners[:, 1].max())
    middle_phi = 0.5 * (corners[:, 0].min() + corners[:, 0].max())
    high = middle_z - corners[:, 1].min() + 4e-4
    wide = radius * (middle_phi - corners[:, 0].min()) + 4e-4
    for v in range(box[0], box[1]):
        for u in range(box[2], box[3]):
            phi, z = _place_at(fields, v, u, slope)
            turn = _turned(phi - middle_phi)
            if abs(radius * turn) > wide or abs(z - middle_z) > high:
                continue
            most, line = 0.0, (0.0, 0.0, 0.0, 0.0, 0.0)
            for n in range(corners.shape[0] - 1):
                x, y = radius * (turn + middle_phi - corners[n, 0]), z - corners[n, 1]
                ax = radius * (corners[n + 1, 0] - corners[n, 0])
                ay = corners[n + 1, 1] - corners[n, 1]
                along, cross = x * ax + y * ay, x * ay - y * ax
                square = ax * ax + ay * ay
                if cross * cross > square * 4e-7 or along < -4e-4 * square**0.5:
                    continue
                share = min(max(along / square, 0.0), 1.0)
                x, y = x - share * ax, y - share * ay
                off = np.sqrt(x * x + y * y) + 1e-12
                half = corners[n, 2] + share * (corners[n + 1, 2] - corners[n, 2])
                if off > half + 4e-4:
                    continue
                pixel = _pixel_size(radius, slope, x, y, off)
                near = min(max(0.5 + (half - off) / pixel, 0.0), 1.0)
                far = min(max(0.5 + (-half - off) / pixel, 0.0), 1.0)
                if near - far > most:
                    most, size = near - far, square**0.5
                    line = cross / size, pixel, half, ay / size, -ax / size
            if most > 0.0:
                _light_at(fields, v, u, now)
                value = metal[4] * now[4]
                for first in range(COMMON, now.size, PER_LED):
                    value += now[first]
                value *= metal[0] * look[0]
                if look[1] > 0.0:
                    value = _in_groove(now, *line, look[1], look[0], metal)
                radiance[v, u] = (1.0 - most) * radiance[v, u] + most * value


@njit(cache=True, nogil=True)
def add_water(fields, radius, height, rays, rotations, positions, leds, strengths, radiance):
    """Draw the surface of the water: dull, with a mirrored spot for each LED."""
    slope, d, way = np.empty((2, 2)), np.empty(3), np.empty(3)
    for v in range(radiance.shape[0]):
        i = v // CELL
        turn, lens = rotations[i], positions[i]
        for u in range(radiance.shape[1]):
            phi, _ = _place_at(fields, v, u, slope)
            if radius * np.sin(phi) <= height:
                continue
            su, sv, j = (u % CELL) / CELL, (v % CELL) / CELL, u // CELL
            d[:] = 0.0
            for a in range(3):
                for b in range(3):
                    ray = (1 - sv) * ((1 - su) * rays[i, j, b] + su * rays[i, j + 1, b])
                    ray += sv * ((1 - su) * rays[i + 1, j, b] + su * rays[i + 1, j + 1, b])
                    d[a] += turn[a, b] * ray
            norm = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
            for a in range(3):
                d[a] /= norm
            length = min((height - lens[1]) / max(d[1], 1e-6), _FARTHEST)
            value = 0.0
            for k in range(leds.shape[0]):
                far, ahead = 0.0, 0.0
                for a in range(3):
                    way[a] = lens[a] - (lens[a] + length * d[a])
                    for b in range(3):
                        way[a] += turn[a, b] * leds[k, b]
                    far += way[a] * way[a]
                way /= np.sqrt(far)
                for a in range(3):
                    ahead -= way[a] * turn[a, 2]
                power = strengths[k] * max(ahead, 0.0) * _NEAR / far
                face = max(-way[1], 0.0)
                half = way - d
                up = max(-half[1], 0.05)
                square = (half[0] ** 2 + half[2] ** 2) / (up * up * 0.05**2)
                fresnel = 0.02 + 0.98 * (1.0 - min(d[1], 1.0)) ** 5
                value += power * (0.06 * face + fresnel * 8.0 / (1.0 + square) ** 2)
            radiance[v, u] = value


@njit(cache=True, nogil=True, fastmath=True)
def drag(radiance, du, dv, out):
    """Average along the motion (du, dv) of the image during the exposure, in pixels."""
    rows, columns = radiance.shape
    taps = int(np.ceil(max(abs(du), abs(dv)))) + 1
    out[:] = _ZERO
    weight = _ONE / _F(taps)
    for n in range(taps):
        at = (n + 0.5) / taps - 0.5
        x, y = at * du, at * dv
        j, i = int(np.floor(x)), int(np.floor(y))
        sx, sy = _F(x - j), _F(y - i)
        for v in range(rows):
            a = radiance[min(max(v + i, 0), rows - 1)]
            b = radiance[min(max(v + i + 1, 0), rows - 1)]
            for u in range(max(-j, 0), min(columns - 1 - j, columns)):
                top = a[u + j] + sx * (a[u + j + 1] - a[u + j])
                low = b[u + j] + sx * (b[u + j + 1] - b[u + j])
                out[v, u] += weight * (top + sy * (low - top))
            for u in range(max(-j, 0)):
                out[v, u] += weight * a[0]
            for u in range(min(columns - 1 - j, columns), columns):
                out[v, u] += weight * a[columns - 1]


@njit(cache=True, nogil=True, fastmath=True)
def nudge(radiance, du, dv, out):
    """Average as ``drag`` for a motion of about a pixel, by the second derivatives."""
    rows, columns = radiance.shape
    a, b, c = _F(du * du / 24.0), _F(dv * dv / 24.0), _F(du * dv / 48.0)
    here = _ONE - _F(2.0) * (a + b)
    for v in range(rows):
        up, line, down = radiance[max(v - 1, 0)], radiance[v], radiance[min(v + 1, rows - 1)]
        target = out[v]
        target[0], target[columns - 1] = line[0], line[columns - 1]
        for u in range(1, columns - 1):
            target[u] = (
                here * line[u]
                + a * (line[u - 1] + line[u + 1])
                + b * (up[u] + down[u])
                + c * (up[u - 1] + down[u + 1] - up[u + 1] - down[u - 1])
            )


@njit(cache=True, nogil=True, fastmath=True)
def _variances(fields, row, line):
    """Compute the variance of the blur along one row of pixels."""
    i, share = row // CELL, _F(row % CELL) / _F(CELL)
    for j in range(fields.shape[2] - 1):
        left = fields[3, i, j] + share * (fields[3, i + 1, j] - fields[3, i, j])
        right = fields[3, i, j + 1] + share * (fields[3, i + 1, j + 1] - fields[3, i, j + 1])
        slope = (right - left) / _F(CELL)
        for k in range(CELL):
            line[j * CELL + k] = left + slope * _F(k)


@njit(cache=True, nogil=True, fastmath=True)
def blur(image, fields, spare):
    """Blur in place by the variance in ``fields``: three taps, then again twice as far apart.

    A pass with taps ``a, 1 - 2 a, a`` at distance d adds variance 2 a d^2; a is at most 0.3.
    """
    rows, columns = image.shape
    most = _ZERO
    for i in range(fields.shape[1]):
        for j in range(fields.shape[2]):
            most = max(most, fields[3, i, j])
    line = np.empty(columns, np.float32)
    gap, done = 1, _ZERO
    while done < most and gap <= 8:
        unit = _F(2 * gap * gap)
        for v in range(rows):
            _variances(fields, v, line)
            source, target = image[v], spare[v]
            for u in range(columns):
                a = min(max((line[u] - done) / unit, _ZERO), _F(0.3))
                line[u] = a
            for u in range(gap):
                target[u] = source[u]
                target[columns - 1 - u] = source[columns - 1 - u]
            # Slices that begin at 0: the compiler vectorises no other loop.
            left, right = source[: columns - 2 * gap], source[2 * gap :]
            middle, part = source[gap : columns - gap], line[gap : columns - gap]
            inner = target[gap : columns - gap]
            for u in range(inner.size):
                inner[u] = middle[u] + part[u] * (left[u] + right[u] - middle[u] - middle[u])
        for v in range(rows):
            _variances(fields, v, line)
            up, here = spare[max(v - gap, 0)], spare[v]
            down, target = spare[min(v + gap, rows - 1)], image[v]
            for u in range(columns):
                a = min(max((line[u] - done) / unit, _ZERO), _F(0.3))
                target[u] = here[u] + a * (up[u] + down[u] - here[u] - here[u])
        done += _F(0.3) * unit
        gap *= 2


@njit(cache=True, nogil=True, fastmath=True)
def shrink(image, most, small):
    """Compute means of cells, with pixels clipped to ``most``."""
    for i in range(small.shape[0]):
        for j in range(small.shape[1]):
            total = _ZERO
            for v in range(i * CELL, (i + 1) * CELL):
                for u in range(j * CELL, (j + 1) * CELL):
                    total += min(image[v, u], most)
            small[i, j] = total / _F(CELL * CELL)


@njit(cache=True, nogil=True, fastmath=True)
def expose(image, veil, dirt, scale, noise, starts, read, shot, out):
    """Turn radiance into grey levels with noise.

    ``veil`` (V, U) glare at nodes, ``dirt`` (H, W) the transmission of the lens, ``noise`` (M,)
    standard normal numbers of which each row takes a run from ``starts`` (H,), ``read`` standard
    deviation in grey levels, ``shot`` variance per grey level.
    """
    columns = image.shape[1]
    square = read * read
    glare = np.empty(columns, np.float32)
    for v in range(image.shape[0]):
        i, share = v // CELL, _F(v % CELL) / _F(CELL)
        for j in range(veil.shape[1] - 1):
            left = veil[i, j] + share * (veil[i + 1, j] - veil[i, j])
            right = veil[i, j + 1] + share * (veil[i + 1, j + 1] - veil[i, j + 1])
            slope = (right - left) / _F(CELL)
            for k in range(CELL):
                glare[j * CELL + k] = left + slope * _F(k)
        random = noise[starts[v] : starts[v] + columns]
        for u in range(columns):
            level = scale * dirt[v, u] * (image[v, u] + glare[u])
            level += random[u] * np.sqrt(square + shot * level)
            out[v, u] = np.uint8(min(max(level + _HALF, _ZERO), _F(255.0)))
