"""Pictures from cameras, streams, videos and folders of images, through OpenCV.

An address is one of

- ``camera:0`` or ``camera:/dev/video2``: a camera of this machine;
- ``camera:rtsp://...``, ``camera:http://...`` or ``https``: a camera in the network (MJPEG);
- a video file, or a folder of images, which are taken in the order of their names;
- ``module:package.function``, a function that returns a `FrameSource`, and ``SCHEME:NAME`` of
  another package, whose entry point of the group ``minorloop.cameras`` returns one for the name.

Pictures are converted to grey.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from minorloop.connect import factory
from minorloop.errors import InstrumentError, MinorloopError, ParameterError
from minorloop.registry import loaded, registered
from minorloop_head.sources import Frame, FrameSource
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.imaging import opencv

NO_NEW_PICTURE = "gives no new picture"
"""Message on a camera that gave pictures before, and gives none in time."""
SCHEME, _CAMERAS = "camera:", "minorloop.cameras"
_IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")
"""Endings of the images in a folder."""
_Target: TypeAlias = int | str | Path | Callable[[], FrameSource]
_STREAMS = ("rtsp://", "http://", "https://")
_RATE = 25.0
"""Images per second of a folder, and of a video without a rate."""
_OPENING, _READING = 3000, 1000
"""Longest time in ms until a stream opens, and until it gives a picture."""
_RENEWAL = 5.0
"""Least time in seconds for which a stream of the wrong size stays open."""
_END_OF_JPEG, _PADDING = b"\xff\xd9", 64
"""Last bytes of a JPEG, and most bytes that a camera may append."""
_CLOSING = 5.0
"""Longest time in seconds to close a camera, since it may still be opening."""
_AGAIN = 0.5
"""Seconds until a lost camera is opened again."""
_LATEST = 5.0
"""Longest time in seconds from a picture to its arrival; a longer one means another clock."""
_EXPOSURE_UNITS = 1e4
"""Units of exposure of cameras under Linux in a second: they are 100 microseconds long."""
_BY_HAND = 1
"""Value that turns the automatic exposure of such cameras off."""


def check_camera(address: str) -> None:
    """Refuse an address that is neither of a camera nor of pictures in files.

    Raises a `ParameterError` if it is not.
    """
    _target(address)


def _is_live(address: str) -> bool:
    """Return whether an address is of a camera, and not of files."""
    return address.startswith(SCHEME) or address.partition(":")[0] in registered(_CAMERAS)


def open_module(name: str) -> FrameSource:
    """Return the camera that ``package.function`` of a Python module creates.

    The module is installed or in the current folder.
    """
    made: FrameSource = factory(name)()
    return made


def frames(address: str, *, damaged: bool = False) -> Iterator[Frame]:
    """Yield every picture of a folder, a video, or a single image, one after the other.

    Raises a `ParameterError` if it is neither a folder with images nor a video that can be read, or
    an image cannot be read.

    ``address``: times begin at 0: those in the video, by its rate if it has none, or 0.04 s for
    each image of a folder; ``damaged``: whether an image that cannot be read is yielded as one
    without pixels.
    """
    target = _target(address)
    if not isinstance(target, Path):
        raise ParameterError(f"{address} is a camera; give a folder, a video or an image")
    images = _images(target)
    if not images:
        yield from _video(target)
    for number, path in enumerate(images):
        yield Frame(number / _RATE, _image(path, damaged))


def names(address: str) -> list[str]:
    """Return the names of the images behind an address; empty for a video."""
    target = _target(address)
    return [path.name for path in _images(target)] if isinstance(target, Path) else []


class LiveCamera:
    """Newest picture of a camera, which a thread receives.

    A lost camera is opened until it answers. A folder or a video runs at its own rate.

    ``patience``: longest seconds that `frame` waits. Raises a `ParameterError` if the address is
    not one of a camera, a video or a folder of images.
    """

    def __init__(self, address: str, patience: float = 0.08) -> None:
        self._target, self.address, self.patience = _target(address), address, patience
        self._cv2 = opencv()
        self.timed_by_camera = False
        self._changed = threading.Condition()
        self._newest: Frame | None = None
        self._problem = f"{address} has given no picture yet"
        self._wanted: tuple[float, float] | None = None
        self._ended = self._renewing = False
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()

    def frame(self) -> Frame:
        """Return the newest picture; each picture is returned once.

        Its time is in seconds on the machine's monotonic clock: that of the camera, if
        ``timed_by_camera``, and otherwise that of its arrival. Cameras of this machine under
        Video4Linux give times; network cameras do not.

        Raises an `InstrumentError` if no picture comes within the patience.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._ended, self.patience)
            newest, self._newest = self._newest, None
        if newest is None:
            advice = "check the camera and its cable"
            if isinstance(self._target, Path):
                advice = "give a longer video, more pictures, or a camera"
            raise InstrumentError(f"{self._problem}; {advice}")
        return newest

    def expose(self, exposure: float, gain: float = 1.0) -> None:
        """Set the exposure time in seconds, and the gain, from one of the next pictures on.

        A camera without these settings ignores them.
        """
        self._wanted = (exposure, gain)

    def renew(self) -> None:
        """Reopen a stream that may have changed its size, unless it was opened just now.

        OpenCV keeps the size at the opening, unless each picture is a JPEG.
        """
        self._renewing = True

    @property
    def exposes(self) -> bool:
        """Whether `expose` may set anything: files and cameras in the network do not offer it."""
        return not isinstance(self._target, str | Path)

    def close(self) -> None:
        """Close the camera, and wait until it is closed; a current read may take a second.

        If the program ended while OpenCV reads in a thread, it would be aborted.
        """
        self._over.set()
        self._thread.join(_CLOSING)

    def _receive(self) -> None:
        while not self._over.is_set():
            try:
                if isinstance(self._target, Path):
                    self._play()
                    return
                self._watch()
            except MinorloopError as error:
                self._problem = str(error)
            self._over.wait(_AGAIN)

    def _play(self) -> None:
        began = time.monotonic()
        for each in frames(self.address):
            if self._over.wait(max(began + each.t - time.monotonic(), 0.0)):
                return
            self._give(each.image)
        with self._changed:
            self._problem, self._ended = f"{self.address} has ended", True
            self._changed.notify_all()

    def _watch(self) -> None:
        """Receive pictures until the camera is lost."""
        cv2 = self._cv2
        camera = _opened(self._target, self.address)
        try:
            if not camera.isOpened():
                raise InstrumentError(f"{self.address} cannot be opened")
            self._renewing = False
            stream = isinstance(self._target, str)
            jpegs = stream and _undecoded(cv2, camera)
            renewable = time.monotonic() + (_RENEWAL if stream and not jpegs else math.inf)
            while not self._over.is_set():
                if self._renewing and time.monotonic() > renewable:
                    return
                self._set_exposure(camera)
                good, picture = camera.read()
                if not good:
                    raise InstrumentError(f"{self.address} gives no picture")
                image = _decoded(cv2, picture.ravel()) if jpegs else _grey(cv2, picture)
                if image is None:
                    self._problem = f"{self.address} gives damaged pictures"
                    continue
                self._give(image, self._time_by(camera))
        finally:
            camera.release()

    def _set_exposure(self, camera: Any) -> None:
        """Set the exposure that was requested since the last picture."""
        wanted, self._wanted = self._wanted, None
        if wanted is not None and isinstance(camera, _SourceCapture):
            camera.expose(*wanted)
        elif wanted is not None and not isinstance(self._target, str):
            cv2 = self._cv2
            camera.set(cv2.CAP_PROP_AUTO_EXPOSURE, _BY_HAND)
            camera.set(cv2.CAP_PROP_EXPOSURE, wanted[0] * _EXPOSURE_UNITS)
            camera.set(cv2.CAP_PROP_GAIN, wanted[1])

    def _time_by(self, camera: Any) -> float | None:
        """Return the time of a picture by a camera of this machine; None if it gives none."""
        if not isinstance(self._target, int):
            return None
        taken = 1e-3 * float(camera.get(self._cv2.CAP_PROP_POS_MSEC))
        return taken if 0.0 <= time.monotonic() - taken < _LATEST else None

    def _give(self, image: Image, taken: float | None = None) -> None:
        with self._changed:
            self.timed_by_camera = taken is not None
            self._newest = Frame(time.monotonic() if taken is None else taken, image)
            self._problem = f"{self.address} {NO_NEW_PICTURE}"
            self._changed.notify_all()


class _SourceCapture:
    """A `FrameSource` with the interface of a camera of OpenCV."""

    def __init__(self, open_source: Callable[[], FrameSource], address: str) -> None:
        self._address = address
        self._source: Any = self._done(open_source)

    def isOpened(self) -> bool:
        return hasattr(self._source, "frame")

    def read(self) -> tuple[bool, Image]:
        return True, self._done(lambda: self._source.frame().image)

    def expose(self, exposure: float, gain: float) -> None:
        if hasattr(self._source, "expose"):
            self._done(lambda: self._source.expose(exposure, gain))

    def release(self) -> None:
        getattr(self._source, "close", lambda: None)()

    def _done(self, work: Callable[[], Any]) -> Any:
        try:
            return work()
        except MinorloopError:
            raise
        except (Exception, SystemExit) as error:
            said = f"{type(error).__name__}: {error}"
            raise InstrumentError(f"{self._address} failed: {said}") from error


def _target(address: str) -> _Target:
    """Return the number of a camera, its network address, a path, or a function that opens it."""
    scheme, _, name = address.partition(":")
    if scheme in registered(_CAMERAS):
        open_source = loaded(registered(_CAMERAS)[scheme], address)
        return partial(open_source, name)
    if not _is_live(address):
        if Path(address).exists():
            return Path(address)
        raise ParameterError(
            f"there is no file or folder {address!r}; give one, or camera:0, camera:/dev/video0, "
            "camera:rtsp://..., camera:http://... or module:PACKAGE.FUNCTION"
        )
    place = address.removeprefix(SCHEME)
    device = place.removeprefix("/dev/video")
    if device.isascii() and device.isdigit():
        return int(device)
    if place.startswith(_STREAMS):
        return place
    raise ParameterError(
        f"there is no camera at {address!r}; give camera:0, camera:/dev/video0, "
        "camera:rtsp://..., camera:http://... or module:PACKAGE.FUNCTION"
    )


def _opened(target: _Target, address: str = "") -> Any:
    if callable(target):
        return _SourceCapture(target, address)
    cv2 = opencv()
    if not isinstance(target, str):
        return cv2.VideoCapture(target if isinstance(target, int) else str(target))
    limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPENING, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _READING]
    return cv2.VideoCapture(target, cv2.CAP_FFMPEG, limits)


def _images(target: Path) -> list[Path]:
    """Return the images of a folder in the order of their names, or a single image."""
    if target.is_dir():
        found = sorted(path for path in target.iterdir() if path.suffix.lower() in _IMAGES)
        if not found:
            raise ParameterError(f"{target} has no images; they end in {', '.join(_IMAGES)}")
        return found
    return [target] if target.suffix.lower() in _IMAGES else []


def _image(path: Path, damaged: bool) -> Image:
    cv2 = opencv()
    try:
        found = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    except cv2.error:  # it claims to be too large
        found = None
    if found is None and damaged:
        return np.empty((0, 0), np.uint8)
    if found is None:
        raise ParameterError(f"{path} cannot be read as an image; repair it or take it away")
    image: Image = found
    return image


def _video(path: Path) -> Iterator[Frame]:
    cv2, video = opencv(), _opened(path)
    try:
        if not video.isOpened():
            raise ParameterError(f"{path} cannot be read as a video; convert it to another format")
        rate = video.get(cv2.CAP_PROP_FPS)
        interval = 1.0 / rate if math.isfinite(rate) and rate > 0 else 1.0 / _RATE
        number, good, before = 0, True, -math.inf
        while good:
            good, picture = video.read()
            if good:
                t = 1e-3 * float(video.get(cv2.CAP_PROP_POS_MSEC))
                if not before < t < math.inf:  # the file has no times
                    t = number * interval
                yield Frame(t, _grey(cv2, picture))
                number, before = number + 1, t
    finally:
        video.release()


def _undecoded(cv2: Any, camera: Any) -> bool:
    """Request undecoded pictures of a stream; return whether they are JPEGs.

    OpenCV scales pictures that it decodes to the size at the opening.
    """
    jpegs = int(camera.get(cv2.CAP_PROP_FOURCC)) == cv2.VideoWriter.fourcc(*"MJPG")
    return jpegs and bool(camera.set(cv2.CAP_PROP_FORMAT, -1))


def _decoded(cv2: Any, coded: Any) -> Image | None:
    """Return the picture of a JPEG; None if it is damaged, or a part of it is missing."""
    if coded[-_PADDING:].tobytes().rfind(_END_OF_JPEG) < 0:
        return None
    try:
        image: Image | None = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        return None
    return image


def _grey(cv2: Any, picture: Any) -> Image:
    image: Image = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    return image
