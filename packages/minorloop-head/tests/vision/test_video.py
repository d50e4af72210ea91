import socket
import sys
import threading
from contextlib import closing, contextmanager, suppress

import cv2
import numpy as np
import pytest

from minorloop.errors import InstrumentError
from minorloop_head.vision.video import LiveCamera, check_camera, frames, names

SIZE = (48, 64)


def picture(number):
    """A picture whose grey in the middle tells its number."""
    rng = np.random.default_rng(number)
    noise = rng.integers(0, 40, (*SIZE, 3), dtype=np.uint8)
    noise[16:32, 16:48] = 40 * number + 20
    return noise


def number_of(image):
    return round((float(image[18:30, 20:44].mean()) - 20) / 40)


def part(number):
    """A picture as the camera sends it, by its number, or as bytes."""
    jpeg = number
    if not isinstance(number, bytes):
        jpeg = cv2.imencode(".jpg", picture(number))[1].tobytes()
    head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
    return head.encode() + jpeg + b"\r\n"


@contextmanager
def served(*connections):
    """An MJPEG camera: for each connection, the numbers of its pictures; it stalls after the last.

    A picture is sent when the one before it was taken, by ``go``.
    """
    go, over = threading.Semaphore(0), threading.Event()
    listening = socket.create_server(("127.0.0.1", 0))

    def serve():
        for k, numbers in enumerate(connections):
            try:
                link, _ = listening.accept()
            except OSError:
                return
            with link:
                link.recv(4096)
                link.sendall(
                    b"HTTP/1.1 200 OK\r\n"
                    b"Content-Type: multipart/x-mixed-replace; boundary=next\r\n\r\n"
                )
                for number in numbers:
                    link.sendall(part(number))
                    go.acquire()
                if k == len(connections) - 1:
                    over.wait()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield f"camera:http://127.0.0.1:{listening.getsockname()[1]}/video", go
    finally:
        over.set()
        for _ in range(100):
            go.release()
        listening.close()
        thread.join()


@contextmanager
def live(address, patience=20.0):
    with closing(LiveCamera(address, patience)) as camera:
        yield camera


@pytest.fixture
def folder(tmp_path):
    for number in range(4):
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture(number))
    (tmp_path / "notes.txt").write_text("no image")
    return tmp_path


@pytest.fixture
def video(tmp_path):
    path = tmp_path / "pipe.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 50.0, SIZE[::-1])
    for number in range(4):
        writer.write(picture(number))
    writer.release()
    return path


def test_a_folder_and_a_video_give_their_pictures_in_grey_with_their_times(folder, video):
    for source, interval in ((folder, 0.04), (video, 0.02)):
        found = list(frames(str(source)))
        assert [number_of(each.image) for each in found] == [0, 1, 2, 3]
        assert [each.t for each in found] == pytest.approx([k * interval for k in range(4)])
        assert {each.image.shape for each in found} == {SIZE}
    assert names(str(folder)) == ["0.png", "1.png", "2.png", "3.png"]


def test_a_camera_in_the_network_that_changes_its_size_gives_that_of_each_picture():
    small = cv2.imencode(".jpg", picture(1)[::2, ::2])[1].tobytes()
    with served([0, small, 2]) as (address, go), live(address) as camera:
        shown = []
        for _ in range(3):
            shown.append(camera.frame().image.shape)
            go.release()
        assert shown == [SIZE, (24, 32), SIZE]


def test_half_pictures_are_left_out_and_the_camera_stays_open():
    whole = cv2.imencode(".jpg", picture(1))[1].tobytes()
    damaged = [whole[: len(whole) // 2], b"no picture", b"no picture\xff\xd9"]
    with served([0, *damaged, 3]) as (address, go), live(address) as camera:
        assert number_of(camera.frame().image) == 0
        for _ in range(4):
            go.release()
        assert number_of(camera.frame().image) == 3


def test_a_stream_that_keeps_its_first_size_is_opened_again_on_request(monkeypatch):
    monkeypatch.setattr("minorloop_head.vision.video._RENEWAL", 0.0)
    opened = []

    class Stream(Device):
        def get(self, what):
            return 0.0  # no JPEGs

        def read(self):
            return True, np.zeros((len(opened), 64), np.uint8)

    monkeypatch.setattr(
        "minorloop_head.vision.video._opened", lambda *_: opened.append(1) or Stream()
    )
    monkeypatch.setattr("minorloop_head.vision.video._AGAIN", 0.0)
    with live("camera:rtsp://127.0.0.1/") as camera:
        assert camera.frame().image.shape == (1, 64)
        camera.renew()
        while camera.frame().image.shape == (1, 64):
            pass


def test_a_camera_that_stalls_delays_nobody_longer_than_the_patience():
    with served([0]) as (address, go), live(address) as camera:
        go.release()
        first = camera.frame()
        camera.patience = 0.0
        with pytest.raises(InstrumentError, match="check the camera and its cable"):
            camera.frame()
        assert number_of(first.image) == 0


class Device:
    """A camera of this machine, as OpenCV has them, that gives a time in ms with each picture."""

    def __init__(self, taken=0.0):
        self.taken, self.released = taken, []

    def isOpened(self):
        return True

    def read(self):
        return True, np.zeros(SIZE, np.uint8)

    def get(self, what):
        assert what == cv2.CAP_PROP_POS_MSEC
        return self.taken

    def release(self):
        self.released.append(True)


@pytest.mark.parametrize(
    ("taken", "t"), [(99.97, 99.97), (100.01, 100.0), (0.0, 100.0), (float("nan"), 100.0)]
)
def test_pictures_have_the_time_of_the_camera_if_it_is_one_of_our_clock(monkeypatch, taken, t):
    monkeypatch.setattr("minorloop_head.vision.video.time.monotonic", lambda: 100.0)
    device = Device(1e3 * taken)
    monkeypatch.setattr("minorloop_head.vision.video._opened", lambda *_: device)
    with live("camera:0") as camera:
        assert camera.frame().t == pytest.approx(t)
        assert camera.timed_by_camera == (t == taken)


def test_a_camera_that_was_lost_is_opened_again():
    with served([0], [4]) as (address, go), live(address) as camera:
        assert number_of(camera.frame().image) == 0
        go.release()  # the first connection is closed
        assert number_of(camera.frame().image) == 4


def test_a_camera_that_is_not_there_is_named():
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with (
        live(f"camera:http://127.0.0.1:{port}/", patience=0.0) as camera,
        pytest.raises(
            InstrumentError, match=f"{port}/ (has given no picture yet|cannot be opened)"
        ),
    ):
        camera.frame()


HOME_MADE = """
import numpy as np
from minorloop_head.sources import Frame

class Camera:
    exposures = []

    def frame(self):
        if self.exposures:  # an opened camera would soon have another state
            raise ValueError("no such exposure")
        return Frame(0.0, np.full((48, 64, 3), 60, np.uint8))

    def expose(self, exposure, gain):
        self.exposures.append((exposure, gain))
        raise ValueError("no such exposure")

def nobody():
    raise OSError("no cable")
"""


def test_a_function_of_a_module_makes_a_camera_whose_failures_are_sentences(tmp_path, monkeypatch):
    (tmp_path / "home_camera.py").write_text(HOME_MADE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*sys.path])
    check_camera("module:home_camera.Camera")
    with closing(LiveCamera("module:home_camera.Camera", patience=20.0)) as camera:
        assert camera.frame().image.shape == SIZE
        assert camera.exposes
        camera.expose(2e-3, 1.5)
        camera.patience = 0.1
        while "no such exposure" not in camera._problem:
            with suppress(InstrumentError):
                camera.frame()
        assert "module:home_camera.Camera failed: ValueError" in camera._problem
    assert sys.modules["home_camera"].Camera.exposures[0] == (2e-3, 1.5)
    with (
        closing(LiveCamera("module:home_camera.nobody", patience=0.2)) as camera,
        pytest.raises(InstrumentError, match=r"nobody failed: OSError: no cable|no picture yet"),
    ):
        camera.frame()
