"""A camera in the network, simulated: an MJPEG stream of the pictures in a folder, over and over.

It is a program of its own, made of Python's standard library only: it knows HTTP and nothing else.
It shows the pictures forwards and backwards, prints its address, and runs until it is ended::

    python examples/simulated_camera.py pictures --port 8080
"""

import argparse
import contextlib
import http.server
import itertools
import pathlib
import time

BOUNDARY = "picture"


class Camera(http.server.BaseHTTPRequestHandler):
    pictures, interval = [], 0.04

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
        self.end_headers()
        due = time.monotonic()
        with contextlib.suppress(ConnectionError):
            for picture in itertools.cycle([*self.pictures, *self.pictures[-2:0:-1]]):
                head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}"
                self.wfile.write(head.encode() + b"\r\n\r\n" + picture + b"\r\n")
                due += self.interval
                time.sleep(max(due - time.monotonic(), 0.0))

    def log_message(self, *_):
        """Print nothing for a request."""


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("folder", help="folder with JPEG pictures, shown in order of their names")
    options.add_argument("--port", type=int, default=0, help="port to listen on; any without it")
    options.add_argument("--rate", type=float, default=25.0, help="pictures a second")
    given = options.parse_args()
    files = sorted(pathlib.Path(given.folder).glob("*.jpg"))
    Camera.pictures, Camera.interval = [file.read_bytes() for file in files], 1.0 / given.rate
    server = http.server.ThreadingHTTPServer(("127.0.0.1", given.port), Camera)
    server.daemon_threads = True
    print(f"http://127.0.0.1:{server.server_port}/", flush=True)
    server.serve_forever()


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
