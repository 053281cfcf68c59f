"""A mesh as a scene: what it hides and stops is that of boxes, and what cannot be flown in is said."""

import copy
import dataclasses
import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

trimesh = pytest.importorskip("trimesh", reason="the extra `mesh` is not installed")
pytest.importorskip("embreex", reason="the extra `mesh` is not installed")

import baselines  # noqa: E402
from activeslam_gym import Scenario, check_scene  # noqa: E402
from activeslam_gym.camera import hidden  # noqa: E402
from activeslam_gym.config import TRAINING_SEED, fields_of  # noqa: E402
from activeslam_gym.envs.setting import scenario_with  # noqa: E402
from activeslam_gym.evaluation import play  # noqa: E402
from activeslam_gym.world.furniture import first_hits  # noqa: E402
from activeslam_gym.world.mesh import MeshFactory  # noqa: E402
from examples.extend_mesh import flat  # noqa: E402

BOX = np.array(((1.0, -1.25, 0.5), (1.6, 0.6, 1.9)))
HALF = np.array((3.0, 1.25, 2.5))


def room(*boxes: np.ndarray) -> Any:
    """The inside of a room, with ``boxes`` (2, 3) in it, of 50 000 triangles or more."""
    parts = [trimesh.creation.box(bounds=bounds) for bounds in (np.stack((-HALF, HALF)), *boxes)]
    mesh = trimesh.util.concatenate(parts)
    while len(mesh.faces) < 50_000:
        mesh = mesh.subdivide()
    return mesh


def saved(mesh: Any, folder: Path, name: str = "mesh.glb") -> str:
    mesh.export(folder / name)
    return str(folder / name)


def test_a_box_room_as_a_mesh_hides_and_stops_as_the_boxes_do(tmp_path: Path) -> None:
    scene, rng = MeshFactory(saved(room(BOX), tmp_path))(Scenario(), None), np.random.default_rng(0)
    np.testing.assert_allclose(scene.bounds, (-HALF, HALF), atol=1e-6)
    ways = rng.standard_normal((2000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    for eye in scene._places[:10]:
        points = rng.uniform(-HALF, HALF, (2000, 3))
        points = points[((points < BOX[0] - 0.01) | (points > BOX[1] + 0.01)).any(axis=1)]
        assert scene.blocks(eye, points).tolist() == [hidden(BOX[None], eye, point) for point in points]
        free = scene.clearance(np.tile(eye, (len(ways), 1)), ways, 20.0)
        np.testing.assert_allclose(free, first_hits(BOX[None], HALF, eye, ways), atol=1e-4)


def test_landmarks_are_on_surfaces_that_face_the_inside(tmp_path: Path) -> None:
    scene = MeshFactory(saved(room(BOX), tmp_path))(Scenario(), None)
    points, normals = scene.sample(500, np.random.default_rng(1))
    on = np.isclose(np.abs(points), HALF, atol=1e-5).any(axis=1)
    assert (on | np.isclose(points[:, None], BOX, atol=1e-5).any((1, 2))).all()
    assert (scene.clearance(points + 1e-3 * normals, normals, 0.5) > 0.1).mean() > 0.95
    assert not scene.blocks(scene.start(np.random.default_rng(2)), scene._places).all()


def test_a_flat_is_flown_alone_and_in_a_batch_to_the_bit(tmp_path: Path) -> None:
    given = {"scenario": {"scene": saved(flat(), tmp_path)}, "duration": 4.0, "end_when_lost": False}
    check_scene(given["scenario"]["scene"])
    many = gym.make_vec("ActiveSLAM-v0", num_envs=2, autoreset_mode="DISABLED", **given)
    batch = play(many, baselines.make("mi-mi", many), [TRAINING_SEED, TRAINING_SEED + 1])
    one = gym.make("ActiveSLAM-v0", render_mode="rgb_array", **given)
    single = play(one, baselines.make("mi-mi", one), [TRAINING_SEED + 1])[0]
    np.testing.assert_array_equal(batch[1].log_score, single.log_score)
    assert one.render().std() > 0.0
    assert single.log_score[-1] > 0.0
    assert one.unwrapped.scenario.room_size == (8.1, 2.6, 6.1)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(one.spec.to_json()))
    assert json.loads(one.spec.to_json()) and again.unwrapped.scenario == one.unwrapped.scenario
    assert copy.deepcopy(one.unwrapped.truth.scene).bounds.tolist() == one.unwrapped.truth.scene.bounds.tolist()


def with_polygons(mesh: Any, floor: list[tuple[float, float]], file: Path) -> str:
    """The mesh as OBJ, with another face of many corners at the middle of its height."""
    own = len(mesh.vertices)
    lines = [f"v {x} {y} {z}" for x, y, z in [*mesh.vertices, *((x, mesh.bounds[:, 1].mean(), z) for x, z in floor)]]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces]
    file.write_text(
        "\n".join([*lines, f"f {' '.join(str(own + 1 + k) for k in range(len(floor)))}", "f -3//1 -2//1 \\\n -1//1"])
    )
    return str(file)


def test_a_concave_face_is_refused_and_a_convex_one_is_not(tmp_path: Path) -> None:
    """`findings/trimesh_fills_concave_faces.sh`."""
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.5), (0.5, 0.5), (0.5, 1.0), (0.0, 1.0)]
    for first in range(6):
        notched = with_polygons(flat(), corners[first:] + corners[:first], tmp_path / f"notched{first}.obj")
        with pytest.raises(ValueError, match="not convex; export triangles"):
            MeshFactory(notched)(Scenario(), None)
    header = "ply, format ascii 1.0, element vertex 6, property float x, property float y, property float z"
    lines = [*header.split(", "), "element face 1", "property list uchar int vertex_indices", "end_header"]
    lines += [*(f"{x} 0 {z}" for x, z in corners), "6 0 1 2 3 4 5\n"]
    (tmp_path / "notched.ply").write_text("\n".join(lines))
    with pytest.raises(ValueError, match="not convex; export triangles"):
        MeshFactory(str(tmp_path / "notched.ply"))(Scenario(), None)
    corners[3] = (0.8, 0.8)
    assert MeshFactory(with_polygons(flat(), corners, tmp_path / "convex.obj"))(Scenario(), None).bounds.shape == (2, 3)
    MeshFactory(with_polygons(flat(), corners[::-1], tmp_path / "from_below.obj"))(Scenario(), None)


def test_faces_that_count_backwards_before_other_corners_are_refused(tmp_path: Path) -> None:
    """`findings/trimesh_counts_back_from_the_last_vertex.sh`."""
    whole = Path(with_polygons(flat(), [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], tmp_path / "last.obj"))
    MeshFactory(str(whole))(Scenario(), None)  # nothing follows its face of -3 -2 -1
    followed = tmp_path / "followed.obj"
    followed.write_text(whole.read_text() + "\nv 0 0 0\n")
    with pytest.raises(ValueError, match="count corners backwards"):
        MeshFactory(str(followed))(Scenario(), None)


def test_axes_and_unit_are_options(tmp_path: Path) -> None:
    plain = MeshFactory(saved(flat(), tmp_path))(Scenario(), None)
    turned = flat().apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2.0, (1.0, 0.0, 0.0)))
    other = MeshFactory(saved(turned.apply_scale(1000.0), tmp_path, "flat.ply"), up="z", unit=0.001)(Scenario(), None)
    np.testing.assert_allclose(other.bounds, plain.bounds, atol=1e-4)


def test_a_mesh_of_another_unit_is_made_again_from_its_spec(tmp_path: Path) -> None:
    """Its spec's JSON was refused."""
    factory = MeshFactory(saved(flat().apply_scale(1000.0), tmp_path, "flat.ply"), unit=0.001)
    for given in ({"scene": factory}, {"scenario": {"scene": dataclasses.asdict(factory)}}):
        env = gym.make("ActiveSLAM-v0", **given)
        again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
        assert again.unwrapped.scenario == env.unwrapped.scenario and again.unwrapped.scenario.scene == factory
        assert scenario_with(json.loads(json.dumps(fields_of(env.unwrapped.scenario)))) == env.unwrapped.scenario
        again.reset(seed=0)


def opened() -> Any:
    """A floor, a wall and nothing else."""
    walls = ((8.0, 0.1, 6.0), (0.0, 0.0, 0.0)), ((8.0, 2.5, 0.1), (0.0, 1.25, 3.0))
    return trimesh.util.concatenate(
        [trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in walls]
    )


def test_what_cannot_be_flown_in_is_told_with_its_cause(tmp_path: Path) -> None:
    (tmp_path / "text.ply").write_text("nothing")
    large = saved(flat().apply_scale(1000.0), tmp_path, "large.glb")
    for scenario, match in (
        ({"scene": large}, "unit"),
        ({"scene": saved(opened(), tmp_path, "opened.glb")}, "holes"),
        ({"scene": str(tmp_path / "none.glb")}, "scenario.scene"),
        ({"scene": str(tmp_path / "text.ply")}, "no mesh"),
        ({"scene": saved(flat(), tmp_path), "start": "corner"}, "start"),
        ({"scene": {"path": saved(flat(), tmp_path), "up": "x"}}, "y or z, "),
        ({"scene": saved(flat(), tmp_path), "varied": (("room_size", (5, 2, 5), (8, 2.5, 8)),)}, "scenario.varied"),
        ({"scene": "house.dae"}, r"\*\.stl, or a dict of path"),
        ({"scene": {"path": "flat.glb", "units": 1.0}}, r"\*\.stl, or a dict of path"),
        ({"scene": {"path": 5}}, "path must"),
        ({"scene": {"path": "flat.glb", "unit": "mm"}}, "positive number of metres"),
    ):
        with pytest.raises(ValueError, match=match):
            gym.make("ActiveSLAM-v0", scenario=scenario)
