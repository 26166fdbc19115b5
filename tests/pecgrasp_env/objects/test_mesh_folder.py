"""One's own meshes: what is taken, what is cached, what is refused and how."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import sapien
import trimesh

from pecgrasp_env.objects import MeshFolder, ObjectError, open_objects
from pecgrasp_env.objects import mesh_folder as module
from pecgrasp_env.objects.meshing import convex_cache
from pecgrasp_env.objects.meshing import convex_decomposition as decompose
from pecgrasp_env.objects.meshing.convex_hulls import convex_hull, depth_below
from pecgrasp_env.objects.meshing.mesh_cache import cache_folder, with_normals

REAL = Path(__file__).parents[4] / "shared" / "data" / "meshes"


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))


def put(folder: Path, name: str, mesh: trimesh.Trimesh) -> Path:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    mesh.export(str(file))
    return file


def brick() -> trimesh.Trimesh:
    return trimesh.creation.box((0.1, 0.06, 0.04))


def test_classes_are_folders_and_instances_are_files(tmp_path):
    for name in ("brick/b.stl", "brick/a.ply", "brick/c.obj", "brick/d.glb", "ball/x.ply"):
        put(tmp_path, name, brick())
    (tmp_path / "brick" / "notes.txt").write_text("not a mesh")
    (tmp_path / ".git").mkdir()
    folder = open_objects(tmp_path)
    assert isinstance(folder, MeshFolder)
    assert folder.classes == ("ball", "brick")
    assert folder.names("brick") == ["a", "b", "c", "d"]
    assert open_objects(tmp_path, classes=["brick"]).classes == ("brick",)
    for i in range(4):
        model = folder.load("brick", i)
        np.testing.assert_allclose(model.extents, [0.1, 0.06, 0.04], atol=1e-6)
        assert (model.class_name, model.instance) == ("brick", "abcd"[i])
        assert model.mass == pytest.approx(0.1 * 0.06 * 0.04 * module.DENSITY, rel=0.01)
        np.testing.assert_allclose(np.concatenate(model.hulls).mean(axis=0), 0, atol=0.003)


def test_convex_parts_are_found_once(tmp_path, monkeypatch):
    put(tmp_path, "brick/a.ply", brick())
    first = MeshFolder(tmp_path).load("brick", 0)
    assert [f.suffixes for f in cache_folder().iterdir()] == [[".coacd", ".npz"]]

    def never(vertices, faces):
        raise AssertionError("decomposed again")

    monkeypatch.setattr(convex_cache, "decompose", never)
    again = MeshFolder(tmp_path).load("brick", 0)
    np.testing.assert_array_equal(np.concatenate(first.hulls), np.concatenate(again.hulls))
    small = MeshFolder(tmp_path, scale=0.5).load("brick", 0)  # the parts of a mesh do not depend on its unit
    np.testing.assert_allclose(np.concatenate(small.hulls), np.concatenate(first.hulls) / 2, atol=1e-6)
    put(tmp_path, "brick/a.ply", trimesh.creation.box((0.1, 0.06, 0.05)))
    with pytest.raises(AssertionError, match="again"):  # another mesh under the same name is another mesh
        MeshFolder(tmp_path).load("brick", 0)


def test_a_concave_mesh_is_cut_and_a_mesh_with_holes_is_taken(tmp_path):
    cross = trimesh.util.concatenate(
        [trimesh.creation.box((0.12, 0.02, 0.02)), trimesh.creation.box((0.02, 0.12, 0.02))]
    )
    put(tmp_path, "thing/cross.ply", cross)
    open_ball = trimesh.creation.icosphere(2, 0.04)
    open_ball.update_faces(np.arange(len(open_ball.faces)) % 40 != 0)
    put(tmp_path, "thing/holes.ply", open_ball)
    folder = MeshFolder(tmp_path)
    assert not open_ball.is_watertight
    crossed = folder.load("thing", 0)
    assert len(crossed.hulls) >= 2
    assert crossed.volume < 2 * (2 * 0.12 - 0.02) * 0.02 * 0.02
    holed = folder.load("thing", 1)
    assert holed.volume == pytest.approx(4 / 3 * np.pi * 0.04**3, rel=0.15)
    assert holed.mass >= 0.02


def test_a_mesh_that_is_not_closed_is_refused_or_taken_as_a_shell(tmp_path, monkeypatch):
    monkeypatch.setattr(decompose, "MOST_FACES", 0)
    box = brick()
    box.update_faces(np.arange(12) >= 2)  # a side is missing, the two triangles of it
    box = box.subdivide()  # so that the hole is no quadrangle, which is filled
    put(tmp_path, "thing/open.ply", box)
    with pytest.raises(
        ObjectError, match=r"thing/open\.ply is not closed: 8 of its edges.*Close.*objects\.allow_open=true"
    ):
        MeshFolder(tmp_path).load("thing", 0)
    shell = MeshFolder(tmp_path, allow_open=True).load("thing", 0)
    np.testing.assert_allclose(shell.extents, [0.1, 0.06, 0.04], atol=1e-6)
    assert shell.volume < 1.2 * 0.1 * 0.06 * 0.04


def test_a_surface_that_touches_itself_is_closed(tmp_path):
    """Two bricks that share an edge, which therefore belongs to four faces, as in scans of real objects."""
    pair = trimesh.util.concatenate([brick(), brick().apply_translation((0.1, 0.06, 0))])
    pair.merge_vertices()
    assert not pair.is_watertight
    put(tmp_path, "thing/pair.ply", pair)
    model = MeshFolder(tmp_path).load("thing", 0)
    assert len(model.hulls) == 2
    assert model.volume == pytest.approx(2 * 0.1 * 0.06 * 0.04, rel=0.02)


@pytest.mark.parametrize("why", ["too many faces", "too slow", "the process ends"])
def test_without_coacd_the_surface_is_cut_in_halves(tmp_path, monkeypatch, why):
    if why == "too many faces":
        monkeypatch.setattr(decompose, "MOST_FACES", 10)
    elif why == "too slow":
        monkeypatch.setattr(decompose, "LIMIT_S", 0.01)
    else:
        monkeypatch.setitem(decompose.COACD, "no_such_setting", 1)
    rods = [trimesh.creation.box((0.16, 0.02, 0.02)), trimesh.creation.box((0.02, 0.16, 0.02))]
    put(tmp_path, "thing/cross.ply", trimesh.util.concatenate(rods))
    model = MeshFolder(tmp_path).load("thing", 0)
    solid = (2 * 0.16 - 0.02) * 0.02 * 0.02
    assert 4 <= len(model.hulls) <= 32
    assert 0.999 * solid < model.volume < 1.6 * solid  # its hull has ten times as much
    points = np.concatenate(model.hulls)
    np.testing.assert_allclose(np.ptp(points, axis=0), [0.16, 0.16, 0.02], atol=1e-3)


def test_a_light_mesh_weighs_what_a_gripper_can_hold(tmp_path):
    put(tmp_path, "dice/a.ply", trimesh.creation.box((0.012, 0.012, 0.012)))
    put(tmp_path, "crate/a.ply", trimesh.creation.box((0.5, 0.5, 0.5)))
    assert MeshFolder(tmp_path).load("dice", 0).mass == pytest.approx(0.02)
    assert MeshFolder(tmp_path).load("crate", 0).mass == pytest.approx(module.HEAVIEST)


def test_the_mass_is_that_of_the_mesh_not_of_its_convex_parts(tmp_path, monkeypatch):
    monkeypatch.setattr(decompose, "MOST_FACES", 0)  # halving fills in what a wall bends around
    ring = trimesh.creation.annulus(0.04, 0.05, 0.06)
    put(tmp_path, "ring/a.ply", ring)
    model = MeshFolder(tmp_path).load("ring", 0)
    assert model.volume > 1.04 * ring.volume
    assert model.mass == pytest.approx(module.DENSITY * ring.volume, rel=1e-3)
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
    entity = model.add_to(scene.create_actor_builder()).build("ring")
    body = entity.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
    assert body.mass == pytest.approx(model.mass, rel=0.01)


@pytest.mark.slow
def test_a_two_sided_tray_is_a_thin_shell(tmp_path):
    tray = brick()
    tray.update_faces(tray.face_normals[:, 2] < 0.5)
    tray.faces = np.vstack([tray.faces, tray.faces[:, ::-1]])
    put(tmp_path, "tray/a.ply", tray)
    with pytest.warns(module.MeshWarning, match=r"a\.ply: each face is there once for each side: .* thin open shell"):
        model = MeshFolder(tmp_path).load("tray", 0)
    assert len(model.hulls) > 1
    assert model.volume < 0.5 * 0.1 * 0.06 * 0.04
    inside = np.array([0, 0, 0.01])  # of the middle of the box; the hulls are centred lower
    middle = (model.parts[0].vertices.max(axis=0) + model.parts[0].vertices.min(axis=0)) / 2
    assert all(depth_below((middle + inside)[None], convex_hull(hull.astype(float)))[0] < 0 for hull in model.hulls)


def test_preparing_finds_each_mesh_once_and_names_those_that_cannot_be_used(tmp_path, monkeypatch):
    for name in ("brick/a.ply", "brick/b.ply", "block/c.ply"):
        put(tmp_path, name, brick())
    put(tmp_path, "block/flat.ply", trimesh.creation.box((0.1, 0.1, 1e-7)))
    calls, told = [], []

    def counted(vertices, faces):
        calls.append(len(faces))
        return decompose.decompose(vertices, faces)

    monkeypatch.setattr(convex_cache, "decompose", counted)
    errors = MeshFolder(tmp_path).prepare(at_once=3, progress=lambda done, total: told.append((done, total)))
    assert told == [(i, 4) for i in range(5)]
    assert calls == [12]  # three of one shape, at one time
    assert list(errors) == [("block", 1)]
    assert "flat.ply is a flat sheet" in str(errors["block", 1])
    (file,) = cache_folder().iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])  # as a full disk leaves it
    assert not MeshFolder(tmp_path, classes=["brick"]).prepare()
    assert calls == [12, 12]
    assert len(MeshFolder(tmp_path).load("brick", 0).hulls) == 1


def test_thousands_of_faces_at_one_vertex_take_no_more_than_others():
    """A cone of 24,000 faces and its bottom: pairs of them all would be 1.2 billion."""
    n = 24_000
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    rim = np.stack([0.04 * np.cos(angle), 0.04 * np.sin(angle), 0 * angle], axis=1)
    vertices = np.vstack([[0, 0, 0.04], [0, 0, 0], rim]).astype(np.float32)
    here, following = np.arange(n) + 2, (np.arange(n) + 1) % n + 2
    faces = np.vstack([np.stack([0 * here, here, following], 1), np.stack([0 * here + 1, following, here], 1)])
    points, index, normals, _ = with_normals(vertices, faces.astype(np.int32))
    below = index[n:]
    np.testing.assert_allclose(normals[below].reshape(-1, 3), np.tile([0, 0, -1.0], (3 * n, 1)), atol=1e-3)
    side = normals[index[:n, 1]]
    np.testing.assert_allclose(side, rim / 0.04 * 0.5**0.5 + [0, 0, 0.5**0.5], atol=0.01)
    tip = normals[index[:n, 0]]
    assert (np.einsum("ij,ij->i", tip, side) > np.cos(np.radians(40))).all()
    np.testing.assert_array_equal(points[index[:n, 0]], np.tile(vertices[0], (n, 1)))


@pytest.mark.slow
def test_a_million_faces_need_less_than_a_gigabyte(tmp_path):
    ball = trimesh.creation.icosphere(8, 0.04)
    ball.vertices *= 1 + 0.15 * np.sin(9 * ball.vertices[:, 2:] / 0.04)
    ball.update_faces(np.arange(len(ball.faces)) < 1_000_000)
    (tmp_path / "ball").mkdir()
    ball.export(str(tmp_path / "ball" / "a.ply"))
    code = (
        "import sys; from pecgrasp_env.objects import MeshFolder\n"
        "from pecgrasp_env.objects.meshing.mesh_cache import visual_file\n"
        "model = MeshFolder(sys.argv[1], allow_open=True).load('ball', 0); visual_file(model.parts)\n"
        # Not getrusage's maximum, which a process takes over from the one that started it.
        "status = dict(line.split(':', 1) for line in open('/proc/self/status'))\n"
        "print(len(model.parts[0].faces), status['VmHWM'].split()[0])"
    )
    ran = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True)
    n_faces, kilobytes = map(int, ran.stdout.split())
    assert n_faces == 1_000_000
    assert kilobytes < 1_000_000


def test_folders_that_are_refused(tmp_path):
    with pytest.raises(ObjectError, match=r"nowhere.*not a folder"):
        MeshFolder(tmp_path / "nowhere")
    with pytest.raises(ObjectError, match="no classes"):
        MeshFolder(tmp_path)
    (tmp_path / "brick").mkdir()
    with pytest.raises(ObjectError, match="brick has no mesh"):
        MeshFolder(tmp_path)
    put(tmp_path, "brick/a.ply", brick())
    with pytest.raises(ObjectError, match=r"'drone'.*brick"):
        MeshFolder(tmp_path, classes=["drone"])
    with pytest.raises(ObjectError, match=r"objects\.scale"):
        MeshFolder(tmp_path, scale=0)
    folder = MeshFolder(tmp_path)
    with pytest.raises(ObjectError, match=r"'drone'.*brick"):
        folder.load("drone", 0)
    with pytest.raises(ObjectError, match="asked for 1"):
        folder.load("brick", 1)
    put(tmp_path, "brick/a.stl", brick())
    with pytest.raises(ObjectError, match=r"a\.ply.*a\.stl.*rename"):
        MeshFolder(tmp_path)


def test_meshes_that_are_refused_name_their_file(tmp_path):
    def refused(name: str, match: str, scale: float = 1.0) -> None:
        with pytest.raises(ObjectError, match=match) as caught:
            MeshFolder(tmp_path / name, scale).load("thing", 0)
        assert str(tmp_path / name / "thing") in str(caught.value)

    for name, data in (("garbage.ply", b"\x00\x01garbage"), ("garbage.stl", b""), ("garbage.glb", b"glTF" + bytes(40))):
        file = tmp_path / name / "thing" / name
        file.parent.mkdir(parents=True)
        file.write_bytes(data)
        refused(name, "cannot be read|no faces")
    cloud = tmp_path / "cloud" / "thing" / "cloud.ply"
    cloud.parent.mkdir(parents=True)
    trimesh.PointCloud(np.random.default_rng(0).normal(size=(50, 3))).export(str(cloud))
    refused("cloud", "no faces")
    text = brick().export(file_type="obj").replace("v 0.05", "v nan", 1)
    (tmp_path / "nan" / "thing").mkdir(parents=True)
    (tmp_path / "nan" / "thing" / "nan.obj").write_text(text)
    refused("nan", "not numbers|cannot be read")

    put(tmp_path, "millimetres/thing/a.ply", brick().apply_scale(1000))
    refused("millimetres", r"100 m long.*millimetres.*objects\.scale=0\.001")
    MeshFolder(tmp_path / "millimetres", scale=0.001).load("thing", 0)
    put(tmp_path, "kilometre/thing/a.ply", brick().apply_scale(1e5))
    refused("kilometre", r"1e\+04 m long.*objects\.scale is 1")
    put(tmp_path, "speck/thing/a.ply", brick().apply_scale(0.001))
    refused("speck", r"0\.0001 m long, outside 0\.005 to 2\.0 m")


def test_a_flat_sheet_is_refused(tmp_path):
    sheet = trimesh.Trimesh([(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0, 0.1, 0)], [(0, 1, 2), (0, 2, 3)])
    put(tmp_path, "thing/sheet.ply", sheet)
    with pytest.raises(ObjectError, match=r"sheet\.ply.*flat"):
        MeshFolder(tmp_path).load("thing", 0)


@pytest.mark.skipif(not REAL.is_dir(), reason="no real meshes at ../shared/data/meshes")
@pytest.mark.parametrize("name", ["remote_controller", "toothpaste"])
def test_real_scans_lie_still_in_the_simulator(name):
    folder = MeshFolder(REAL / "everyday", classes=[name])
    for i in range(2):
        model = folder.load(name, i)
        scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
        scene.add_ground(0, render=False)
        builder = model.add_to(scene.create_actor_builder())
        builder.set_initial_pose(sapien.Pose([0, 0, 0.005 - min(float(h[:, 2].min()) for h in model.hulls)]))
        entity = builder.build(name)
        for _ in range(400):
            scene.step()
        before = entity.pose.p
        for _ in range(100):
            scene.step()
        assert np.linalg.norm(entity.pose.p - before) < 5e-4
        assert 0 < entity.pose.p[2] < 0.12
