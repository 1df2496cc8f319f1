"""Files of grasps: four formats, the same grasp; what is wrong with one grasp leaves the others."""

import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.errors import InvalidInput
from pipeline.formats import grasp_file
from pipeline.formats.grasp_file import Stated, grasp_files, read_grasp_file

TURN = Rotation.from_euler("xyz", (0.3, -0.5, 2.0))
POSITION, SCALE = np.array([0.01, -0.02, 0.3]), 0.08
JOINTS, ANGLES = ("j0", "j1"), np.array([0.25, -0.5])
POSE = np.block([[TURN.as_matrix(), POSITION[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])


def arrays(**changes: Any) -> dict[str, Any]:
    """Write two grasps as arrays; the second has another angle."""
    pose = POSE.copy()
    pose[:3, 3] /= SCALE
    same = {"hand_pose": np.stack([pose, pose]), "joint_angles": np.stack([ANGLES, 2 * ANGLES]), "joint_names": np.array(JOINTS)}
    return {**same, "metres_per_unit": np.array(SCALE), **changes}


def bench(**changes: Any) -> dict[str, Any]:
    """Write a grasp as DexGraspBench does, its object moved and turned."""
    scene = np.eye(4)
    scene[:3, :3], scene[:3, 3] = Rotation.from_euler("z", 1.0).as_matrix(), (0.5, 0.6, 0.7)
    placed = scene @ POSE
    quaternions = [Rotation.from_matrix(matrix[:3, :3]).as_quat(scalar_first=True) for matrix in (placed, scene)]
    qpos = np.array([*placed[:3, 3], *quaternions[0], *ANGLES], np.float32)
    closing = np.array([0] * 7 + [0.1, 0.1], np.float32)
    return {
        "obj_path": "assets/bottle",
        "obj_scale": np.float64(SCALE),
        "obj_pose": np.array([*scene[:3, 3], *quaternions[1]]),
        "pregrasp_qpos": qpos - closing,
        "grasp_qpos": qpos,
        "squeeze_qpos": qpos + closing,
        **changes,
    }


def net(**changes: Any) -> dict[str, Any]:
    """Write a grasp as DexGraspNet does."""
    rotation = dict(zip(("WRJRx", "WRJRy", "WRJRz"), TURN.as_euler("xyz").tolist(), strict=True))
    position = dict(zip(("WRJTx", "WRJTy", "WRJTz"), POSITION.tolist(), strict=True))
    return {"qpos": {**position, **rotation, **dict(zip(JOINTS, ANGLES.tolist(), strict=True))}, "scale": SCALE, **changes}


def read(tmp_path: Path, content: Any) -> list[Stated | InvalidInput]:
    """Write a file of arrays, of one dictionary or of several, and read it."""
    if isinstance(content, dict) and "hand_pose" in content:
        path = tmp_path / "a.npz"
        np.savez(path, **content)
    else:
        path = tmp_path / "a.npy"
        np.save(path, np.array(content, object), allow_pickle=True)
    return [grasp.stated for grasp in read_grasp_file(path, tmp_path)]


def refusal(stated: Stated | InvalidInput) -> str:
    assert isinstance(stated, InvalidInput)
    return str(stated)


@pytest.mark.parametrize(("content", "names", "error"), [(arrays(), JOINTS, 1e-12), (bench(), (), 1e-6), ([net()], JOINTS, 1e-12)])
def test_formats_state_the_same_grasp(content: Any, names: tuple[str, ...], error: float, tmp_path: Path) -> None:
    stated = read(tmp_path, content)[0]
    assert isinstance(stated, Stated)
    assert stated.scale == pytest.approx(SCALE)
    np.testing.assert_allclose(stated.root, POSE, atol=error)
    np.testing.assert_allclose(stated.angles["grasp"], ANGLES, atol=error)
    assert stated.joints == names


def test_pregrasp_and_squeeze_are_read_where_they_are(tmp_path: Path) -> None:
    (stated,) = read(tmp_path, bench())
    assert isinstance(stated, Stated)
    for phase, step in (("pregrasp", -0.1), ("squeeze", 0.1)):
        np.testing.assert_allclose(stated.angles[phase], ANGLES + step, atol=1e-6)
    (stated,) = read(tmp_path, [net()])
    assert isinstance(stated, Stated)
    assert set(stated.angles) == {"grasp"}


def test_dictionary_with_rows_is_several_grasps(tmp_path: Path) -> None:
    rows = {name: np.stack([values, values]) for name, values in bench().items() if name.endswith("_qpos")}
    first, second = read(tmp_path, bench(**rows, obj_scale=np.array([0.08, 0.1])))
    assert isinstance(first, Stated)
    assert isinstance(second, Stated)
    assert (first.scale, second.scale) == (0.08, 0.1)
    np.testing.assert_array_equal(first.root, second.root)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (bench(grasp_qpos=np.full(9, np.nan)), "grasp_qpos has a value that is not finite"),
        (bench(grasp_qpos=np.full(9, 0.1)), "is no rotation: a quaternion"),
        (bench(grasp_qpos=np.zeros(12)), "pregrasp_qpos has shape \\(9,\\) .* must be numbers of shape \\(12,\\)"),
        (bench(pregrasp_qpos=np.zeros((9, 9))), "pregrasp_qpos has shape \\(9, 9\\) .* must be numbers of shape \\(9,\\)"),
        (bench(grasp_qpos=np.zeros((2, 9)), pregrasp_qpos=np.zeros((1, 9))), "pregrasp_qpos has shape \\(1, 9\\)"),
        (bench(grasp_qpos=np.zeros((9, 3, 9))), "grasp_qpos has shape \\(9, 3, 9\\); it must have 7 numbers of the root"),
        (bench(grasp_qpos=np.zeros(7)), "grasp_qpos has shape \\(7,\\); it must have 7 numbers of the root and those of all joints"),
        (bench(joint_names=np.array("a")), "joint_names has type <U1 and shape \\(\\); it must be a list of names"),
        (bench(joint_names=np.array([["a"], None], object)), "joint_names has type object"),
        (bench(grasp_qpos=[0.0] * 9), "it has no array grasp_qpos"),
        (bench(obj_pose=np.zeros(3)), "obj_pose has shape \\(3,\\)"),
        (bench(joint_names=np.array(["a"])), "joint_names has 1 names, the joints in grasp_qpos are 2"),
        (bench(obj_scale=0.0), "obj_scale is 0; it must be metres per unit"),
        ({name: value for name, value in bench().items() if "obj" not in name} | {"scene_path": "a.npy"}, "task=format"),
        ([net(qpos={})], "it has no number WRJTx"),
        ([net(qpos=3)], "qpos is no dictionary"),
        ([net(scale="big")], "it has no number scale"),
        ([{"joints": 1}], "it has the entries 'joints'; known are dictionaries with grasp_qpos"),
        ([3], "it has no dictionary; known are"),
        (arrays(joint_names=np.array([1, 2])), "joint_names has type int64"),
        (arrays(joint_angles=np.zeros((2, 3))), "joint_angles has shape \\(2, 3\\)"),
        (arrays(metres_per_unit=np.array(-1.0)), "metres_per_unit is -1"),
        (arrays(hand_pose=np.zeros((2, 4, 4))), "last row"),
        (arrays(hand_pose=np.stack([np.diag([1, 1, -1, 1.0])] * 2)), "hand_pose is no rotation and shift"),
        (arrays(hand_pose=np.array(3.0)), "hand_pose has shape \\(\\); it must be \\(G, 4, 4\\)"),
        (arrays(hand_pose=np.eye(4)), "hand_pose has shape \\(4, 4\\); it must be \\(G, 4, 4\\), a matrix per grasp, also of one grasp"),
    ],
)
def test_faults_are_named(content: Any, reason: str, tmp_path: Path) -> None:
    for stated in read(tmp_path, content):
        with pytest.raises(InvalidInput, match=reason):
            raise stated if isinstance(stated, InvalidInput) else AssertionError(stated)


def test_a_wrong_grasp_leaves_the_others(tmp_path: Path) -> None:
    first, second = read(tmp_path, [net(scale=-1), net()])
    assert "scale is -1" in refusal(first)
    assert isinstance(second, Stated)
    poses = arrays()["hand_pose"].copy()
    poses[0, 0, 0] = np.inf
    first, second = read(tmp_path, arrays(hand_pose=poses))
    assert "hand_pose has a value that is not finite" in refusal(first)
    assert isinstance(second, Stated)


def test_one_scale_is_of_all_rows_and_too_few_are_refused(tmp_path: Path) -> None:
    rows = {name: np.stack([values] * 3) for name, values in bench().items() if name.endswith("_qpos")}
    assert all(isinstance(stated, Stated) for stated in read(tmp_path, bench(**rows, obj_scale=np.array([SCALE]))))
    assert "obj_scale has 2 values" in refusal(read(tmp_path, bench(**rows, obj_scale=np.array([SCALE, SCALE])))[2])


def test_rows_are_limited_whatever_they_hold(tmp_path: Path) -> None:
    for content in (bench(grasp_qpos=np.empty((10**8, 0))), arrays(hand_pose=np.zeros((100_001, 4, 4), np.int8))):
        (stated,) = read(tmp_path, content)
        assert "more than 100000 grasps; split it" in refusal(stated)


def test_files_that_are_no_arrays_are_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "whole.npz").write_bytes(b"")
    np.savez(tmp_path / "whole.npz", **arrays())
    whole = (tmp_path / "whole.npz").read_bytes()
    contents = {
        "empty.npy": b"",
        "text.npy": b"grasps",
        "cut.npz": whole[:500],
        "pickle.npy": pickle.dumps(bench()),
        "damaged.npz": whole[:200] + bytes([whole[200] ^ 255]) + whole[201:],
    }
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
        (grasp,) = read_grasp_file(tmp_path / name, tmp_path)
        assert "that can be read" in refusal(grasp.stated), name


def test_python_objects_in_npz_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", hand_pose=np.array([{}], object), allow_pickle=True)
    (grasp,) = read_grasp_file(tmp_path / "a.npz", tmp_path)
    assert refusal(grasp.stated).startswith("hand_pose is no array that can be read (Object arrays cannot be loaded when")
    assert refusal(grasp.stated).endswith("write numbers, and names as text, with numpy.savez")


def test_names_without_letters_are_refused_before_they_are_listed(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **arrays(joint_names=np.ndarray(1000, "<U0")))
    (grasp,) = read_grasp_file(tmp_path / "a.npz", tmp_path)
    assert refusal(grasp.stated).startswith("joint_names has type <U0, whose values are empty")


def test_archives_that_expand_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez_compressed(tmp_path / "a.npz", hand_pose=np.zeros((1000, 4, 4)))
    monkeypatch.setattr(grasp_file, "MAX_BYTES", 10_000)
    (grasp,) = read_grasp_file(tmp_path / "a.npz", tmp_path)
    assert "more than 10000 bytes" in refusal(grasp.stated)


def test_archives_that_numpy_does_not_write_are_refused(tmp_path: Path) -> None:
    """Members of other compressions are expanded at once, whatever they need."""
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("hand_pose.npy", b"0")
    (grasp,) = read_grasp_file(tmp_path / "a.npz", tmp_path)
    assert "it is compressed in another way than NumPy does" in refusal(grasp.stated)


def test_origins_name_file_and_grasp(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([net(), net()], object), allow_pickle=True)
    assert [grasp.origin for grasp in read_grasp_file(tmp_path / "a.npy", tmp_path)] == ["a.npy, grasp 0", "a.npy, grasp 1"]


def test_files_of_an_object_are_named_as_it_or_in_its_folder(tmp_path: Path) -> None:
    names = ("mug.npz", "mug/scale06/10.npy", "mug/scale06/9.npy", "mug/scale08/0.npy", "mug/notes.txt", "mug-2.npy", "jar.npy")
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")

    def names_of(object_id: str) -> list[str]:
        return [path.relative_to(tmp_path).as_posix() for path in grasp_files(tmp_path, object_id)]

    assert names_of("mug") == ["mug.npz", "mug/scale06/9.npy", "mug/scale06/10.npy", "mug/scale08/0.npy"]
    assert names_of("mug-scale06") == ["mug/scale06/9.npy", "mug/scale06/10.npy"]
    assert names_of("mug-2") == ["mug-2.npy"]
    assert names_of("cup") == names_of("-") == names_of("mug-") == []
