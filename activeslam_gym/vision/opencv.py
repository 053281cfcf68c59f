"""OpenCV, which reads images and finds corners: optional, and imported when it is first needed."""

import os
from typing import Any


def opencv() -> Any:
    """The module `cv2`; a ModuleNotFoundError names the extra."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")  # the one who reads reports errors
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    try:
        import cv2
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "OpenCV is needed: pip install opencv-python-headless, or in a clone: pip install -e '.[vision]'"
        ) from None
    return cv2
