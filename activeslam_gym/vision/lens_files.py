"""Files of lenses of other programs: OpenCV, ROS, Kalibr, EuRoC, camodocal, ORB-SLAM, Basalt and COLMAP."""

import itertools
import json
import re
import reprlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from activeslam_gym.files import text_of
from activeslam_gym.vision.calibration import unique

EITHER = ("", "pinhole", "perspective", "rectified", "none")
RADIAL = ("radtan", "radialtangential", "plumbbob", "rationalpolynomial", "brown", "opencv", "pinholefull",
          "pinholeradtan", "pinholeradtan8", "0", "false")  # fmt: skip
FISHEYE = ("fisheye", "equidistant", "equidist", "equi", "pinholeequi", "kannalabrandt", "kannalabrandt4",
           "kannalabrandt8", "kb4", "opencvfisheye", "1", "true")  # fmt: skip
"""Words for the two models, as `_key` has them; the first say nothing of the distortion, or that there is none."""
_MODEL = re.compile("(cam|camera|dist|distortion|fisheye|lens|model)*(distortion|model|type)|projection(model|type)?")
_MATRICES = ("cameramatrix", "k", "mtx", "kleft")
_LISTS = ("distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoeff", "distcoefs", "distcoef", "dist", "d",
          "dleft")  # fmt: skip
_BENDING = re.compile(".*(distort|coef|radial|tangential).*(?<!stddev)|xi|alphac?|beta|tau[xy]|[bt]\\d")
"""Fields that name the model, matrices, lists of coefficients, and others that bend a lens, which are not read."""
_RAW = ("left", "stereorectifier")  # cameras of images that are not rectified, beside one of those that are
_SIZES = ("resolution", "cameraresolution")
_SIDES = (("imagewidth", "width", "cols"), ("imageheight", "height", "rows"))
_FOCI = (("fx", "mu"), ("fy", "mv"), ("cx", "u0"), ("cy", "v0"))
_PARTS = ("intrinsics", "projectionparameters", "distortionparameters", "mirrorparameters")
_ORDER, _FOUR, _KANNALA = "k1 k2 p1 p2 k3 k4 k5 k6".split(), "k1 k2 k3 k4".split(), "k2 k3 k4 k5".split()
"""Names of coefficients in OpenCV's order: radial-tangential ones, a fisheye's, and those as camodocal has them."""
COLMAP = {
    "SIMPLE_PINHOLE": "f cx cy", "PINHOLE": "fx fy cx cy", "SIMPLE_RADIAL": "f cx cy k1", "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2", "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "SIMPLE_FISHEYE": "f cx cy", "FISHEYE": "fx fy cx cy", "SIMPLE_RADIAL_FISHEYE": "f cx cy k1",
    "RADIAL_FISHEYE": "f cx cy k1 k2", "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
}  # fmt: skip
"""COLMAP's models and their parameters."""
_SHORTEST = 0.05  # focal length of a lens, of the image's longer side: at that, 169 degrees of a pinhole


class Lens(NamedTuple):
    """A lens of OpenCV's; pixel (0, 0) is the centre of the first pixel."""

    size: tuple[int, int]  # width and height [px]
    fisheye: bool
    matrix: np.ndarray  # (3, 3), may have skew
    coefficients: np.ndarray  # (4,), (5,), (8,), (12,) or (14,); of a fisheye (4,)
    note: str = ""  # which it is, where its file holds several, or names no model

    def fields(self) -> dict[str, Any]:
        """The lens as OpenCV has it in JSON, with its model's name."""
        kind: dict[str, Any] = {"type_id": "opencv-matrix", "dt": "d"}
        bent = self.coefficients.tolist()
        return {
            "image_width": self.size[0],
            "image_height": self.size[1],
            "distortion_model": "fisheye" if self.fisheye else "radtan",
            "camera_matrix": {**kind, "rows": 3, "cols": 3, "data": self.matrix.ravel().tolist()},
            "distortion_coefficients": {**kind, "rows": 1, "cols": len(bent), "data": bent},
        }


def read_lens(path: str | Path, camera: str | None = None) -> Lens:
    """The lens of a ``camera`` in a calibration; without a name that of `cam0`, or of the first.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: nothing that is known is in it, a number is missing, or it holds no such camera.
    """
    text = text_of(path)
    rows = [line.split() for line in text.splitlines() if not line.lstrip().startswith("#") and line.strip()]
    found = dict[str, list[Any]]()
    try:
        colmap = rows and len(rows[0]) > 3 and re.fullmatch(r"\d+ [A-Z_]+", " ".join(rows[0][:2]))
        cameras = [(row[0], row) for row in rows] if colmap else [*itertools.chain(*map(_cameras, _parsed(text)))]
        for name, fields in cameras:
            found.setdefault(name, []).append(fields)
        if not found:
            model = re.search(r"""(?i)(?:model|type)["':= ]+([\w.-]+)""", text)
            named = f"; it names the model {model[1]}" if model else ""
            write = "write image_width, image_height, camera_matrix and distortion_coefficients, as OpenCV does"
            raise ValueError(f"focal_px, fx, camera_matrix and intrinsics are missing{named}: {write}")
        names, name = ", ".join(found), "cam0" if "cam0" in found else next(iter(found))
        if camera is None and _key(name) == "camera" and (raw := [n for n in found if _key(n) in _RAW]):
            raise ValueError(f"{name} is of rectified images: --camera {name}, or --camera {raw[0]} for others")
        if camera is not None:
            name = next((n for n in found if n == camera or re.fullmatch(rf".*\D{re.escape(camera)}", n)), "")
            if not name:
                raise ValueError(f"--camera {camera} is not there; it holds {names}")
        lens, *again = (_of_fields(_of_colmap(fields) if colmap else fields) for fields in found[name])
        if any(other.fields() != lens.fields() for other in again):
            raise ValueError(f"it holds {1 + len(again)} lenses without names, or with the same, and they differ")
        which = f"{name} of {names}, see --camera; " if camera is None and len(found) > 1 else ""
        return lens._replace(note=which + lens.note)
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(f"{path} holds no lens of OpenCV, ROS, Kalibr, ORB-SLAM or COLMAP: {error}") from None


def _of_colmap(row: list[str]) -> dict[str, Any]:
    """The fields in a line of cameras.txt: id, model, width, height, parameters; (0.5, 0.5) is its first pixel."""
    if row[1] not in COLMAP:
        raise ValueError(f"COLMAP's model {row[1][:60]!r} is not known; known are {', '.join(COLMAP)}")
    names = COLMAP[row[1]].split()
    if len(row) != 4 + len(names):
        raise ValueError(f"{row[1]} has {len(names)} parameters ({', '.join(names)}), got {len(row) - 4}")
    found: dict[str, Any] = {"k1": 0.0, **{name: _numbers({name: x}, name)[0] for name, x in zip(names, row[4:])}}
    found |= {"cx": found["cx"] - 0.5, "cy": found["cy"] - 0.5, "width": row[2], "height": row[3]}
    if "f" in found:
        found["fx"] = found["fy"] = found["f"]
    return {**found, "model": "fisheye" if row[1].endswith("FISHEYE") else "pinhole"}


def _key(name: object) -> str:
    """The name in small letters and digits: programs write cameraMatrix, Camera_Matrix and camera_matrix."""
    return re.sub(r"[^a-z0-9]", "", str(name).lower())


def _parsed(text: str) -> list[Any]:
    """The documents of a text in JSON, OpenCV's XML or YAML; their leaves are texts, or numbers where it is JSON."""
    import yaml

    class Loader(yaml.BaseLoader):
        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            return unique(self.construct_pairs(node, deep))

    def of_xml(node: ElementTree.Element) -> Any:
        parts = [(part.tag, of_xml(part)) for part in node]
        if parts:  # "_" is a part of OpenCV's sequence
            return [part for _, part in parts] if parts[0][0] == "_" else unique(parts)
        return words[0] if len(words := (node.text or "").split()) == 1 else words

    try:
        if text.lstrip().startswith("<"):
            return [of_xml(ElementTree.fromstring(text.lstrip()))]
        if text.lstrip().startswith("{"):
            return [json.loads(text, object_pairs_hook=unique)]
        text = re.sub(r"(?m)^%.*", "", text)  # and OpenCV needs no space before a list
        return list(yaml.load_all(re.sub(r"(?m)^( *[\w.]+):(?=\[)", r"\1: ", text), Loader))
    except (ValueError, ElementTree.ParseError, yaml.YAMLError, RecursionError) as error:
        raise ValueError(f"it is no proper YAML, JSON or XML: {' '.join(str(error).split())[:200]}") from None


def _cameras(part: Any, name: str = "", outer: dict[str, Any] | None = None) -> Iterator[tuple[str, dict[str, Any]]]:
    """The cameras in nested fields, by name; some programs name the model, or the size, in fields about them."""
    outer = outer or {}
    if isinstance(part, list):
        sizes = outer.get("resolution")  # Basalt's: one for each camera
        apart = isinstance(sizes, list) and len(sizes) == len(part) and isinstance(sizes[0], list)
        for k, one in enumerate(part):
            yield from _cameras(one, f"{name}.{k}", {**outer, "resolution": sizes[k]} if sizes and apart else outer)
    if not isinstance(part, dict):
        return
    nested = dict[str, Any]()
    for path, value in part.items():  # ORB-SLAM's Camera1.fx
        first, dot, rest = str(path).partition(".")
        nested[first] = {**(nested.get(first) or {}), rest: value} if dot else value
    own = {_key(key): value for key, value in nested.items()}
    lists = [own[key] for key in ("intrinsics", *_MATRICES) if isinstance(own.get(key), list | dict)]
    if not own.keys().isdisjoint(("fx", "flx", *_PARTS[1:])) or any(x and not isinstance([*x][0], dict) for x in lists):
        yield name or "0", outer | own
        return
    beside = not own.keys().isdisjoint(("camera1", "camera2", *_RAW)) and isinstance(own.get("camera"), dict)
    outer = outer | {k: x for k, x in own.items() if k == "resolution" or isinstance(x, str | int | float)}
    common = {_key(key): value for key, value in own["camera"].items()} if beside else {}
    outer |= {key: value for key, value in common.items() if _MODEL.fullmatch(key) or key in sum(_SIDES, ())}
    for key, value in nested.items():  # Gyroflow's fisheye_params
        model = {"fisheye": "true"} if _key(key) == "fisheyeparams" else {}
        yield from _cameras(value, f"{name}.{key}".lstrip("."), outer | model)


def _of_fields(camera: dict[str, Any]) -> Lens:
    """The lens of a camera's fields, by the names that these programs use."""
    for part in _PARTS:
        if isinstance(camera.get(part), dict) and "data" not in camera[part]:
            camera = camera | {part: []} | {_key(key): value for key, value in camera[part].items()}
    models = {name: x for name, x in camera.items() if _MODEL.fullmatch(name) and not isinstance(x, list | dict)}
    if not models or ("p1" not in camera and all(_key(word) in EITHER for word in models.values())):  # VINS: a mask
        models |= {name: camera[name] for name in ("fisheye", "isfisheye") if name in camera}
    words = {_key(word): word for word in models.values()}
    if "flx" in camera:
        raise ValueError("transforms.json does not tell where its pixels are counted from: take COLMAP's cameras.txt")
    if unknown := [word for key, word in words.items() if key not in (*EITHER, *RADIAL, *FISHEYE)]:
        raise ValueError(f"the model {str(unknown[0])[:60]!r} is not known: take a radial-tangential one or a fisheye")
    others = [name for name in camera if _BENDING.fullmatch(name) and name not in (*_LISTS, *models)]
    if bends := [name for name in others if re.search("[1-9]|[a-z]{2}", str(camera[name] or 0))]:
        raise ValueError(f"its field {bends[0]} is not known: it needs distortion_coefficients, as OpenCV has them")
    fisheye = not words.keys().isdisjoint(FISHEYE)
    if fisheye and not words.keys().isdisjoint(RADIAL):
        raise ValueError(f"its models contradict each other: {', '.join(map(str, words.values()))}")
    size = _numbers(camera, *_SIZES) or [x for names in _SIDES for x in _numbers(camera, *names)]
    single = [x for names in _FOCI for x in _numbers(camera, *names)]
    four = single or _numbers(camera, "intrinsics")
    K = four or _numbers(camera, *_MATRICES)
    if len(four) == 4:
        K = [four[0], sum(_numbers(camera, "skew")), four[2], 0.0, four[1], four[3], 0.0, 0.0, 1.0]
    order = _KANNALA if "mu" in camera else _FOUR if fisheye else _ORDER
    named = {name: value for name in camera if re.fullmatch(r"[kps]\d", name) for value in _numbers(camera, name)}
    if stray := [name for name, value in named.items() if value and name not in order]:
        raise ValueError(f"{stray[0]} is no coefficient of its model, which has {', '.join(order)}")
    if any(named.values()) and "k4" in named and "p1" not in named and words.keys() <= {*EITHER}:
        raise ValueError("k1 to k4 without p1 and p2 may be a fisheye's: its model must be named, fisheye or radtan")
    coefficients = _numbers(camera, *_LISTS) or ([named.get(name, 0.0) for name in order] if named else [])
    listed = not camera.keys().isdisjoint(_LISTS) or "none" in words
    if not coefficients and (fisheye or not (single or listed)):
        raise ValueError("its coefficients are missing (distortion_model none has none)")
    if any(coefficients) and "none" in words:
        raise ValueError("it names no distortion, and has coefficients")
    if any(float(camera.get(f"binning{axis}", 0)) > 1.0 for axis in "xy"):
        raise ValueError("its images are binned: calibrate the binned images, or set binning_x and binning_y to 1")
    roi = {_key(key): value for key, value in (camera.get("roi") or {}).items()}
    if any(shown := [x for names in (*_SIDES, ["xoffset"], ["yoffset"]) for x in _numbers(roi, *names)]):
        if len(shown) != 4 or len(K) != 9:
            raise ValueError("its roi needs width, height, x_offset and y_offset, and a 3 x 3 matrix beside it")
        size, K[2], K[5] = shown[:2], K[2] - shown[2], K[5] - shown[3]
    lens = _checked(size, fisheye, K, coefficients)
    return lens if words or not any(coefficients) else lens._replace(note="it names no model; ")


def _numbers(camera: dict[str, Any], *names: str) -> list[float]:
    """The numbers of the first of these names, or in its field `data`; none: it lacks. A ValueError: no finite one."""
    name = next((name for name in names if name in camera), "")
    found = camera.get(name, [])
    found = found.get("data") if isinstance(found, dict) else found
    try:
        if np.isfinite(numbers := np.ravel(np.array(found, float))).all():
            return numbers.tolist()
    except (TypeError, ValueError):
        pass
    raise ValueError(f"{name} must be finite numbers, got {reprlib.repr(found)}")


def _checked(size: Any, fisheye: bool, K: list[float], coefficients: list[float]) -> Lens:
    """The lens of these numbers; a ValueError where there are not as many as there should be."""
    if len(size) != 2 or any(side < 1.0 or side % 1.0 for side in size):
        raise ValueError(f"image_width and image_height, or resolution, must be two positive whole numbers, got {size}")
    if len(K) != 9:
        raise ValueError(f"its focal lengths and centre must be four numbers or a 3 x 3 matrix, got {len(K)} numbers")
    if (K[3], *K[6:]) != (0.0, 0.0, 0.0, 1.0):
        raise ValueError(f"camera_matrix must be fx skew cx, 0 fy cy, 0 0 1, got {K}")
    count = len(np.trim_zeros(coefficients, "b"))  # zeros at the end are none
    room = next((room for room in ((4,) if fisheye else (4, 5, 8, 12, 14)) if room >= count), 0)
    if not room or len(coefficients) not in (0, 4, 5, 8, 12, 14):
        raise ValueError(f"{len(coefficients)} coefficients; known are 4, 5, 8, 12 and 14, and 4 of a fisheye")
    numbers = np.array((*K, *coefficients[:room], *[0.0] * (room - len(coefficients))))
    if min(K[0], K[4]) < _SHORTEST * max(size):
        raise ValueError(f"its focal lengths must be at least {_SHORTEST} of the image's side [px], got {K[0]}, {K[4]}")
    return Lens((int(size[0]), int(size[1])), fisheye, numbers[:9].reshape(3, 3), numbers[9:])
