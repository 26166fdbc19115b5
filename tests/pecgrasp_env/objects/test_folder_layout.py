"""Where other people's folders have their meshes, and what is said of those that cannot be told."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pecgrasp_env.objects import MeshFolder, ObjectError
from pecgrasp_env.objects.meshing.mesh_file import read_surface

URDF = """<robot name="x"><link name="base">
<visual><origin xyz="0 0 0.05" rpy="0 0 1.5707963267948966"/><geometry><mesh filename="{}" scale="0.001 0.001 0.001"/>
</geometry></visual><collision><geometry><mesh filename="meshes/collision.obj"/></geometry></collision></link>
</robot>"""


def put(root: Path, *names: str) -> None:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        trimesh.creation.box((0.1, 0.06, 0.04)).export(str(root / name))


def files(root: Path) -> dict[str, dict[str, str]]:
    folder = MeshFolder(root)
    return {
        name: {source.name: source.file.relative_to(root).as_posix() for source in folder._of(name)}
        for name in folder.classes
    }


def test_ycb(tmp_path):
    for kind in ("google_16k", "google_64k", "poisson", "tsdf"):
        put(tmp_path, f"011_banana/{kind}/textured.obj", f"011_banana/{kind}/nontextured.ply")
    put(tmp_path, "012_strawberry/tsdf/nontextured.stl", "012_strawberry/poisson/nontextured.ply")
    put(tmp_path, "025_mug/textured.obj", "025_mug/nontextured.ply", "025_mug/collision.ply")
    (tmp_path / "011_banana" / "clouds").mkdir()
    assert files(tmp_path) == {
        "011_banana": {"011_banana": "011_banana/google_16k/textured.obj"},
        "012_strawberry": {"012_strawberry": "012_strawberry/poisson/nontextured.ply"},
        "025_mug": {"025_mug": "025_mug/textured.obj"},
    }
    with pytest.raises(ObjectError, match=r"011_banana is one object.*'objects\.classes=\[011_banana\]'"):
        MeshFolder(tmp_path / "011_banana")


def test_shapenet(tmp_path):
    put(tmp_path, "02876657/1a/models/model_normalized.obj", "02876657/2b/models/model_normalized.obj")
    (tmp_path / "taxonomy.json").write_text("[]")
    assert files(tmp_path) == {
        "02876657": {
            "1a": "02876657/1a/models/model_normalized.obj",
            "2b": "02876657/2b/models/model_normalized.obj",
        }
    }


@pytest.mark.parametrize("named", ["meshes/visual.obj", "package://red_mug/meshes/visual.obj"])
def test_urdf(tmp_path, named):
    put(tmp_path, "red_mug/meshes/visual.obj", "red_mug/meshes/collision.obj", "red_mug/meshes/visual_vhacd.obj")
    mesh = trimesh.creation.box((100, 60, 40))
    mesh.export(str(tmp_path / "red_mug/meshes/visual.obj"))
    (tmp_path / "red_mug" / "red_mug.urdf").write_text(URDF.format(named))
    assert files(tmp_path) == {"red_mug": {"red_mug": "red_mug/meshes/visual.obj"}}
    surface = read_surface(MeshFolder(tmp_path)._of("red_mug")[0].files)
    np.testing.assert_allclose(surface.vertices.min(axis=0), [-0.03, -0.05, 0.03], atol=1e-9)
    np.testing.assert_allclose(surface.vertices.max(axis=0), [0.03, 0.05, 0.07], atol=1e-9)
    (tmp_path / "red_mug" / "red_mug.urdf").write_text(URDF.format("meshes/none.obj"))
    with pytest.raises(ObjectError, match=r"red_mug\.urdf shows meshes/none\.obj, which is not there"):
        MeshFolder(tmp_path)


def test_objects_in_folders_of_their_own_beside_meshes(tmp_path):
    put(tmp_path, "mug/a.ply", "mug/red_mug/meshes/visual.obj", "mug/red_mug/meshes/collision.obj")
    put(tmp_path, "mug/blue_mug/blue_mug.obj", "mug/blue_mug/lid.obj")
    assert files(tmp_path) == {
        "mug": {"a": "mug/a.ply", "blue_mug": "mug/blue_mug/blue_mug.obj", "red_mug": "mug/red_mug/meshes/visual.obj"}
    }


def test_what_is_made_for_collisions_is_no_instance(tmp_path):
    put(tmp_path, "mug/a.obj")
    for name in ("a_collision", "a_vhacd", "a.convex", "a_convex_3", "coacd/a", "collision/b", "a_coacd", "a-decomp"):
        put(tmp_path, f"mug/{name}.obj")
    put(tmp_path, "mug/reconvexed.obj")
    assert list(files(tmp_path)["mug"]) == ["a", "reconvexed"]
    put(tmp_path, "can/can_collision.obj")
    with pytest.raises(ObjectError, match=r"can has no mesh.*can_collision\.obj is made for collisions"):
        MeshFolder(tmp_path)


def test_other_layouts_are_named_with_the_way_out(tmp_path):
    put(tmp_path / "flat", "a.obj", "b.obj")
    with pytest.raises(ObjectError, match=r"2 meshes lie in it directly.*\n.*for f in \*\.obj; do mkdir -p") as caught:
        MeshFolder(tmp_path / "flat")
    assert f"objects.path={tmp_path}/flat/classes" in str(caught.value)
    put(tmp_path / "deep", "kitchen/mugs/a.ply", "kitchen/mugs/b.ply")
    with pytest.raises(ObjectError, match=r"a\.ply and b\.ply among them.*class mugs,.*\n.*cp -r \S+deep/kitchen/\*"):
        MeshFolder(tmp_path / "deep")
    put(tmp_path / "above", "models/mug/a.ply")
    with pytest.raises(ObjectError, match=r"has no classes, but .*: give objects\.path=\S+/above/models$"):
        MeshFolder(tmp_path / "above")
    (tmp_path / "dae" / "mug").mkdir(parents=True)
    (tmp_path / "dae" / "mug" / "mug.dae").write_text("<COLLADA/>")
    with pytest.raises(ObjectError, match=r"mug\.dae is in a format that is not read\. Export it as \.glb or \.obj"):
        MeshFolder(tmp_path / "dae")
