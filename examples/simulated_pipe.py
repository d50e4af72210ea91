"""A camera in a pipe, simulated: an MJPEG stream of its wall, with holes, under three LEDs.

It is a program of its own, made of NumPy and OpenCV only. `simulated_board.py` tells it by UDP how
its joints stand and which lines are on: "pan tilt led1 led2 led3 pump", angles in degrees. It
prints its address, and runs until it is ended::

    python examples/simulated_pipe.py --port 8080 --listen 7003 &
    python examples/simulated_board.py --port /tmp/board --tell 7003

The camera sits 8 mm before the pivot of the joints, and looks along the pipe at 30 degrees of pan
and of tilt. Its holes are at known places, which it prints with ``--holes``.
"""

import argparse
import contextlib
import http.server
import math
import socket
import threading
import time

try:
    import cv2
    import numpy as np
except ModuleNotFoundError as missing:
    raise SystemExit(
        f"{missing.name} is not installed; run make setup in the copy of the repository and start "
        "this program by .venv/bin/python, or pip install numpy opencv-python-headless"
    ) from None

BOUNDARY = "picture"
WIDTH, HEIGHT, FOCAL = 640, 480, 520.0
RADIUS, LEVER, STRAIGHT = 10e-3, 8e-3, 30.0
"""Of the pipe in m, from the pivot to the lens in m, and degrees of joints that look along it."""
LEDS = 2.5e-3 * np.array([(0.0, 1.0, 0.0), (-0.866, -0.5, 0.0), (0.866, -0.5, 0.0)])
"""Places of the LEDs beside the lens, in m: x to the right, y downwards."""
HOLES = ((0.35, 20.0e-3, 1.0e-3), (2.6, 21.0e-3, 0.95e-3), (-1.4, 19.5e-3, 1.1e-3))
"""Angle about the pipe in radians, place along it and diameter in m."""
TEXEL = 0.05e-3
LENGTH = 80e-3
BRIGHTNESS = 320.0
"""Grey levels of a white wall 10 mm before an LED; little of a picture is overexposed."""
NOISE = 1.5
"""Standard deviation of the noise, in grey levels."""


def wall(seed=0):
    """Return the brightness of the unrolled wall: dirt, scratches and holes."""
    rng = np.random.default_rng(seed)
    rows, columns = round(LENGTH / TEXEL), round(2.0 * math.pi * RADIUS / TEXEL)
    found = np.full((rows, columns), 0.55, np.float32)
    for size, strength in ((3, 0.25), (12, 0.5), (60, 1.2)):
        dirt = rng.standard_normal((rows, columns)).astype(np.float32)
        around = np.hstack([dirt[:, -4 * size :], dirt, dirt[:, : 4 * size]])
        smooth = cv2.GaussianBlur(around, (0, 0), size)[:, 4 * size : -4 * size]
        found *= 1.0 + strength * 0.1 * smooth / smooth.std()
    for phi, z, diameter in HOLES:
        middle = round(16 * (phi % (2.0 * math.pi)) * RADIUS / TEXEL), round(16 * z / TEXEL)
        radius = round(16 * diameter / 2.0 / TEXEL)
        cv2.circle(found, middle, radius, 0.03, -1, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(np.clip(found, 0.0, 1.0), (0, 0), 0.7)


class Pipe:
    """The wall as the camera sees it, at the newest angles and under the newest lights."""

    def __init__(self, seed=0):
        self.wall, self.told = wall(seed), (0.0, 0.0, 1, 1, 1, 0)
        self.rng = np.random.default_rng(seed)
        self.noise = self.rng.normal(0.0, NOISE, 3 * HEIGHT * WIDTH).astype(np.float32)
        self.x = ((np.arange(WIDTH) - (WIDTH - 1) / 2.0) / FOCAL).astype(np.float32)
        self.y = ((np.arange(HEIGHT) - (HEIGHT - 1) / 2.0) / FOCAL).astype(np.float32)[:, None]

    def listen(self, receiving):
        with receiving:
            while True:
                words = receiving.recv(256).decode("ascii", "replace").split()
                with contextlib.suppress(ValueError):
                    pan, tilt, *lines = map(float, words)
                    if len(lines) == 4 and math.isfinite(pan + tilt):
                        self.told = (pan, tilt, *lines)

    def picture(self):
        pan, tilt, *lines = self.told
        turn, lens = pose(pan - STRAIGHT, tilt - STRAIGHT)
        dx, dy, dz = (each[0] * self.x + (each[1] * self.y + each[2]) for each in turn)
        flat, along = dx * dx + dy * dy, lens[0] * dx + lens[1] * dy
        inside = np.float32(lens[0] ** 2 + lens[1] ** 2 - RADIUS**2)
        length = np.minimum(-inside / (along + np.sqrt(along**2 - flat * inside) + 1e-9), 0.15)
        x, y, z = lens[0] + length * dx, lens[1] + length * dy, lens[2] + length * dz
        around = cv2.phase(x, y) * np.float32(RADIUS / TEXEL)
        seen = cv2.remap(
            self.wall, around, z * np.float32(1.0 / TEXEL), cv2.INTER_LINEAR, None,
            cv2.BORDER_REFLECT_101,
        )  # fmt: skip
        seen *= cv2.resize(self.light(turn, lens, lines, x, y, z), (WIDTH, HEIGHT))
        first = self.rng.integers(2 * HEIGHT * WIDTH)
        seen += self.noise[first : first + seen.size].reshape(seen.shape) + 3.0
        return np.clip(seen, 0.0, 255.0).astype(np.uint8)

    def light(self, turn, lens, lines, x, y, z):
        """Return how much light reaches the wall, for every eighth pixel."""
        x, y, z = (each[4::8, 4::8] for each in (x, y, z))
        found = np.zeros(x.shape, np.float32)
        for place, on in zip(LEDS, lines[:3], strict=True):
            if on:
                led = lens + turn @ place
                lx, ly, lz = led[0] - x, led[1] - y, led[2] - z
                far = lx * lx + ly * ly + lz * lz
                facing = np.maximum(-(lx * x + ly * y) / RADIUS, 0.0)
                ahead = np.maximum(-(lx * turn[0, 2] + ly * turn[1, 2] + lz * turn[2, 2]), 0.0)
                found += BRIGHTNESS * 1e-4 * facing * ahead / far**2
        return found

    def jpeg(self):
        return cv2.imencode(".jpg", self.picture(), [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()


def pose(pan, tilt):
    """Return the rotation from the camera to the pipe, and the place of the lens."""
    (cp, sp), (ct, st) = ((math.cos(a), math.sin(a)) for a in map(math.radians, (pan, tilt)))
    turn = np.array([[cp, sp * st, sp * ct], [0.0, ct, -st], [-sp, cp * st, cp * ct]], np.float32)
    return turn, LEVER * turn[:, 2]


class Camera(http.server.BaseHTTPRequestHandler):
    pipe, interval = None, 0.04

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
        self.end_headers()
        due = time.monotonic()
        with contextlib.suppress(ConnectionError):
            while True:
                picture = self.pipe.jpeg()
                head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}"
                self.wfile.write(head.encode() + b"\r\n\r\n" + picture + b"\r\n")
                due = max(due + self.interval, time.monotonic() - self.interval)
                time.sleep(max(due - time.monotonic(), 0.0))

    def log_message(self, *_):
        """Print nothing for a request."""


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--port", type=int, default=0, help="port to listen on; any without it")
    options.add_argument("--listen", type=int, default=7003, help="port to which the board tells")
    options.add_argument("--rate", type=float, default=25.0, help="pictures a second")
    options.add_argument("--holes", action="store_true", help="print where the holes are, and end")
    given = options.parse_args()
    if given.holes:
        for phi, z, diameter in HOLES:
            print(f"{math.degrees(phi):.1f} deg, {1e3 * z:.1f} mm, {1e3 * diameter:.2f} mm wide")
        return
    cv2.setNumThreads(1)
    Camera.pipe, Camera.interval = Pipe(), 1.0 / given.rate
    try:
        receiving = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        receiving.bind(("127.0.0.1", given.listen))
        server = http.server.ThreadingHTTPServer(("127.0.0.1", given.port), Camera)
    except OSError as error:
        raise SystemExit(f"ports {given.port} and {given.listen}: {error.strerror}") from None
    threading.Thread(target=Camera.pipe.listen, args=(receiving,), daemon=True).start()
    server.daemon_threads = True
    print(f"http://127.0.0.1:{server.server_port}/", flush=True)
    server.serve_forever()


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
