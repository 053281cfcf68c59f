"""A rendered room as a model with textures, which the page shows: glTF, by trimesh of the extra `live`."""

from typing import Any

import numpy as np

from activeslam_gym.kernels import Record
from activeslam_gym.vision.room.geometry import Scene
from activeslam_gym.vision.room.shading import SIZE

_FINENESS = 48.0
"""Pixels of a picture for a metre."""
_LIFT = 0.01
"""Distance of posters from what they hang on, which would else show through [m]."""
_HAZE = 0.5
"""Share of white, before which features are seen."""
_SQUARE = np.array(((0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)))
"""Shares of a rectangle's sides at its corners, anticlockwise as seen from its front."""


def model_of(scene: Scene) -> bytes:
    """The rectangles of the ``scene``, which are seen from their fronts alone: from outside one looks into the room."""
    import trimesh
    from PIL import Image
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    model, faces = trimesh.Scene(), 6 * (len(scene.boxes) + 1)
    for k, surface in enumerate(scene.surfaces.view(np.recarray)):
        lift = _LIFT * surface.normal if k < len(scene.surfaces) - faces else 0.0
        corners = surface.corner + lift + _SQUARE @ np.stack((surface.along, surface.down))
        picture = Image.fromarray(painted(surface, scene.textures)).convert("RGB")
        look = TextureVisuals(_SQUARE * (1.0, -1.0) + (0.0, 1.0), PBRMaterial(baseColorTexture=picture))
        model.add_geometry(trimesh.Trimesh(corners, ((0, 1, 2), (0, 2, 3)), visual=look, process=False))
    return model.export(file_type="glb", tree_postprocessor=_unlit)


def _unlit(tree: dict[str, Any]) -> None:
    """Show the pictures of a glTF ``tree`` as they are, without lamps."""
    tree["extensionsUsed"] = ["KHR_materials_unlit"]
    for material in tree["materials"]:
        material["extensions"] = {"KHR_materials_unlit": {}}


def painted(surface: Record, textures: np.ndarray) -> np.ndarray:
    """(h, w) uint8: the texture of a surface as it is lit, through a haze."""
    size = np.array([np.linalg.norm(side) for side in (surface.along, surface.down)])
    pixels = np.maximum(np.rint(_FINENESS * size), 8).astype(int)
    level = int(np.log2(max(1.0, *(surface.texels / pixels))))
    s = SIZE >> level
    u, v = (
        ((start + texels * (np.arange(n) + 0.5) / n) / 2**level).astype(int) % s
        for start, texels, n in zip(surface.texel, surface.texels, pixels)
    )
    grey = textures[surface.texture][2 * (SIZE - s) + v[:, None], u] & 255
    return np.clip(255.0 * _HAZE + (1.0 - _HAZE) * surface.brightness * grey, 0.0, 255.0).astype(np.uint8)
