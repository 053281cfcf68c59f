"""Rules that count images are times: videos of 60 and 120 images a second are tracked as those of 30."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.vision.frontend import FrameLog
from activeslam_gym.vision.report import Agreement
from activeslam_gym.vision.room.camera import RoomCamera
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.start import Start
from studies.excerpts import _ROOM as EXCERPTS
from tests.vision.test_starts import in_motion, lens_of


@pytest.mark.parametrize("rate", [15, 30, 60, 120])
def test_rules_that_count_images_are_the_same_time_from_30_images_a_second_on(rate: int) -> None:
    weight = min(1.0, 30.0 / rate)
    assert FrontEndSettings().timed(1.0 / rate).trials == round(10 / weight)
    for most in (1.0, 1.2):  # features deleted in each thirtieth of a second
        agreement, log = Agreement(False, 1.0 / rate), FrameLog(0.0, 49, 20, 20, 20, 0, 0, 0, *[True] * 4, 0.0)
        deleted = np.diff(np.floor(most * weight * np.arange(10 * rate)))
        held = [agreement.judged(log._replace(deletions=int(count))).start_certain for count in deleted]
        assert held[int(1.5 / weight) * 30] and held[-1] == (most < 1.1)


def test_the_start_at_120_images_a_second_is_that_at_30() -> None:
    lens = lens_of(400.0)
    room, few, many = RoomCamera(EXCERPTS, lens.camera, np.random.SeedSequence(5)), Start(lens), Start(lens)
    for k, camera in enumerate(in_motion(120)):
        image = room.photograph(camera, k)
        many.add(k / 120.0, image)
        if k % 4 == 0:
            few.add(k / 120.0, image)
        if many.best is not None and many.best.certain:
            break
    assert few.best is not None and few.best.certain
    for at_30, at_120 in zip(few.cameras(), many.cameras()):
        np.testing.assert_array_equal(at_30, at_120[::4])
    place = many.cameras()[0][:, :3]
    np.testing.assert_allclose(place[2::4], 0.5 * (place[:-1:4] + place[4::4]), atol=1e-12)
