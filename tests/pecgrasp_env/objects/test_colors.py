"""Colours of mesh files, up to what the renderer shows."""

from pathlib import Path

import numpy as np
import pytest
import sapien
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from pecgrasp_env.objects.contact_sheet import render
from pecgrasp_env.objects.folder_layout import MeshSource
from pecgrasp_env.objects.mesh_folder import MeshWarning, load_mesh
from pecgrasp_env.objects.meshing import convex_cache
from pecgrasp_env.objects.meshing.mesh_file import read_surface
from pecgrasp_env.objects.model import ObjectModel

RED, GREEN, BLUE = (255, 0, 0), (0, 255, 0), (0, 0, 255)
OBJ = "".join(f"v {x} {y} {z}\n" for x in (-0.03, 0.03) for y in (-0.03, 0.03) for z in (-0.03, 0.03))
SIDES = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\n"
ENDS = "f 1 3 7 5\nf 2 6 8 4\n"  # below and above


@pytest.fixture(autouse=True)
def without_coacd(monkeypatch, tmp_path):
    """What is seen does not depend on the convex parts."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("pecgrasp_env.objects.meshing.convex_decomposition.MOST_FACES", 0)
    assert convex_cache.cache_folder().is_relative_to(tmp_path)


def load(file: Path) -> ObjectModel:
    return load_mesh(MeshSource("x", ((file, None),)), "thing")


def colors(model: ObjectModel, above: bool) -> np.ndarray:
    """The colours (N, 3), 0..255, in the middle of the faces that look up or down, or of the others."""
    found = []
    for part in model.parts:
        normals = trimesh.Trimesh(part.vertices, part.faces, process=False).face_normals
        chosen = (np.abs(normals[:, 2]) > 0.5) == above
        if part.texture is None:
            found.append(np.tile(np.array(part.color[:3]) ** (1 / 2.2) * 255, (chosen.sum(), 1)))
        else:
            height, width, _ = part.texture.shape
            u, v = part.uv[chosen].mean(axis=1).T
            found.append(part.texture[((1 - v) * height).astype(int), (u * width).astype(int)])
    return np.concatenate(found)


def is_colored(pixels: np.ndarray, color: tuple[int, int, int]) -> bool:
    """Whether the channel of a pure colour leads clearly in each of the pixels."""
    strong, pixels = np.asarray(color) > 0, pixels.astype(float)
    return bool(len(pixels) and (pixels[..., strong].min(axis=-1) > 2 * pixels[..., ~strong].max(axis=-1)).all())


@pytest.mark.slow
def test_the_renderer_shows_them(tmp_path):
    (tmp_path / "red.obj").write_text(f"mtllib red.mtl\n{OBJ}usemtl a\n{SIDES}{ENDS}")
    (tmp_path / "red.mtl").write_text("newmtl a\nKd 1 0 0\n")
    textured_box(PBRMaterial(baseColorTexture=image())).export(str(tmp_path / "textured.glb"))
    sapien.render.set_camera_shader_dir("minimal")  # what another renderer of this process may have left
    sapien.render.set_picture_format("Color", "r8g8b8a8unorm")
    red, textured = render([load(tmp_path / "red.obj"), load(tmp_path / "textured.glb")], 48)
    for above, picture, color in ((True, red, RED), (False, red, RED), (True, textured, BLUE), (False, textured, RED)):
        assert is_colored(picture[14:18, 22:26] if above else picture[31:33, [17, 18, 29, 30]], color)


def test_mtl_colours(tmp_path):
    (tmp_path / "two.obj").write_text(f"mtllib two.mtl\n{OBJ}usemtl a\n{SIDES}usemtl b\n{ENDS}")
    (tmp_path / "two.mtl").write_text("newmtl a\nKd 1 0 0\n\nnewmtl b\nKd 0 0 1\n")
    model = load(tmp_path / "two.obj")
    assert sorted(part.color for part in model.parts) == [(0.0, 0.0, 1.0, 1.0), (1.0, 0.0, 0.0, 1.0)]
    assert is_colored(colors(model, above=True), BLUE)
    assert is_colored(colors(model, above=False), RED)


def test_an_mtl_that_is_not_there_is_named(tmp_path):
    (tmp_path / "x.obj").write_text(f"mtllib gone.mtl\n{OBJ}usemtl a\n{SIDES}{ENDS}")
    with pytest.warns(MeshWarning, match=r"x\.obj: gone\.mtl is not there, so its colours are not known"):
        model = load(tmp_path / "x.obj")
    assert model.mended == ("gone.mtl is not there, so its colours are not known",)
    (tmp_path / "gone.mtl").write_text("newmtl a\nKd 1 1 1\nmap_Kd skin.png\n")
    with pytest.warns(MeshWarning, match=r"skin\.png is not there"):
        load(tmp_path / "x.obj")


def textured_box(material) -> trimesh.Trimesh:
    """A box whose upper and lower face lie in the texture's lower half, the others in its upper half."""
    box = trimesh.creation.box((0.06, 0.06, 0.06))
    normals = box.face_normals[np.repeat(np.arange(12), 3)]
    flat = trimesh.Trimesh(box.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    uv = np.random.default_rng(0).uniform(0.05, 0.45, (36, 2))
    uv[np.abs(normals[:, 2]) < 0.5, 1] += 0.5
    flat.visual = TextureVisuals(uv=uv, material=material)
    return flat


def image() -> Image.Image:
    pixels = np.zeros((32, 32, 3), np.uint8)
    pixels[:16], pixels[16:] = RED, BLUE
    return Image.fromarray(pixels)


@pytest.mark.parametrize("suffix", [".obj", ".glb", ".gltf"])
def test_textures_stay_on_their_faces(tmp_path, suffix):
    material = SimpleMaterial(image=image()) if suffix == ".obj" else PBRMaterial(baseColorTexture=image())
    file = tmp_path / f"x{suffix}"
    exported = textured_box(material).export(str(file))
    if isinstance(exported, dict):
        for name, data in exported.items():
            (tmp_path / name).write_bytes(data)
    file = next(iter(tmp_path.glob(f"*{suffix}")))
    model = load(file)
    assert is_colored(colors(model, above=True), BLUE)
    assert is_colored(colors(model, above=False), RED)


def test_gltf_colour_and_inside_out_texture(tmp_path):
    box = trimesh.creation.box((0.06, 0.06, 0.06))
    box.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[0, 255, 0, 255]))
    box.export(str(tmp_path / "green.glb"))
    assert is_colored(colors(load(tmp_path / "green.glb"), above=True), GREEN)
    turned = textured_box(SimpleMaterial(image=image()))
    turned.faces = turned.faces[:, ::-1]
    turned.export(str(tmp_path / "turned.obj"))
    with pytest.warns(MeshWarning, match="inside out"):
        model = load(tmp_path / "turned.obj")
    assert is_colored(colors(model, above=True), BLUE)
    assert is_colored(colors(model, above=False), RED)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_vertex_colours(tmp_path, suffix):
    box = trimesh.creation.box((0.06, 0.06, 0.06)).subdivide().subdivide().subdivide()
    above = np.abs(box.vertices[:, 2]) > 0.029
    box.visual.vertex_colors = np.where(above[:, None], (*GREEN, 255), (*RED, 255)).astype(np.uint8)
    box.export(str(tmp_path / f"x{suffix}"))
    model = load(tmp_path / f"x{suffix}")
    assert is_colored(colors(model, above=True), GREEN)
    assert is_colored(np.median(colors(model, above=False), axis=0, keepdims=True), RED)


def test_a_scan_of_many_shades_keeps_them(tmp_path):
    """To one of 32 steps of each channel."""
    ball = trimesh.creation.icosphere(4, 0.04)
    shades = np.random.default_rng(0).integers(0, 256, (len(ball.vertices), 3))
    mesh = trimesh.Trimesh(ball.vertices, ball.faces, vertex_colors=shades, process=False)
    mesh.export(str(tmp_path / "x.ply"))
    surface = read_surface([(tmp_path / "x.ply", None)])
    height, width, _ = surface.looks[0].texture.shape
    rows = np.floor((1 - surface.uv[:, 0, 1]) * height).astype(int)
    columns = np.floor(surface.uv[:, 0, 0] * width).astype(int)
    wanted = shades[ball.faces].mean(axis=1)
    assert np.abs(surface.looks[0].texture[rows, columns] - wanted).max() <= 255 / 31


def test_large_textures_are_reduced(tmp_path):
    material = SimpleMaterial(image=image().resize((3000, 1500)))
    textured_box(material).export(str(tmp_path / "x.obj"))
    assert read_surface([(tmp_path / "x.obj", None)]).looks[0].texture.shape == (512, 1024, 3)
