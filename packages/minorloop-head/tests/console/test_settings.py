import pytest

from minorloop_head.console.settings import LoopSettings


@pytest.mark.parametrize(
    ("timeout", "patience", "pictures"),
    [(0.05, 0.16, 0.12), (0.1, 0.16, 0.12), (0.3, 0.3, 0.3), (5.0, 1.0, 1.0)],
)
def test_a_timeout_lengthens_the_watchdogs_up_to_a_second(timeout, patience, pictures):
    settings = LoopSettings(timeout=timeout)
    config = settings.teleop_config()
    assert (settings.patience, config.pictures) == (patience, pictures)
    assert config.gaze.timeout == config.stick.timeout == timeout
    slower = LoopSettings(timeout=timeout, camera="camera:0").teleop_config()
    assert slower.pictures == max(pictures, 0.16)  # it waits for pictures after a switch
