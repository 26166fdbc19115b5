"""A picture of many objects side by side, rendered by SAPIEN: to see what a catalogue or a mesh folder holds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sapien
from PIL import Image, ImageDraw, ImageFont

from pecgrasp_env.objects.model import ObjectModel

BACKGROUND = (236, 236, 232)


def render(
    models: Sequence[ObjectModel], size: int = 160, azimuth: float = -0.9, elevation: float = 0.75
) -> list[np.ndarray]:
    """Each object on a light ground as (size, size, 3) uint8, seen from one direction (radians), filling the frame."""
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
    scene.set_ambient_light([0.45, 0.45, 0.47])
    scene.add_directional_light(
        [0.35, 0.6, -1.0], [1.7, 1.65, 1.6], shadow=True, shadow_scale=0.3, shadow_map_size=1024
    )
    scene.add_directional_light([-0.8, -0.3, -0.4], [0.35, 0.37, 0.4])
    paper = sapien.render.RenderMaterial(base_color=[0.8, 0.8, 0.78, 1.0], roughness=1.0)
    ground = (
        scene.create_actor_builder().add_box_visual(half_size=(3, 3, 0.01), material=paper).build_kinematic("ground")
    )
    fov = np.radians(18)
    # Global settings of SAPIEN's, which whoever drew before in this process may have changed.
    sapien.render.set_camera_shader_dir("default")
    sapien.render.set_picture_format("Color", "r32g32b32a32sfloat")
    camera = scene.add_camera("camera", 2 * size, 2 * size, fov, 0.01, 10.0)
    toward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    left = np.cross((0, 0, 1), -toward)
    left /= np.linalg.norm(left)
    pictures = []
    for model in models:
        points = np.concatenate([p.vertices for p in model.parts])
        ground.set_pose(sapien.Pose([0, 0, float(points[:, 2].min()) - 0.01]))
        entity = model.add_to(scene.create_actor_builder(), collision=False).build_kinematic("object")
        pose = np.eye(4)
        pose[:3, :3] = rotation = np.stack([-toward, left, np.cross(-toward, left)], axis=1)
        centre = (points.max(axis=0) + points.min(axis=0)) / 2
        seen = (points - centre) @ rotation
        distance = float((np.abs(seen[:, 1:]).max(axis=1) * 1.12 / np.tan(fov / 2) - seen[:, 0]).max())
        pose[:3, 3] = centre + distance * toward
        camera.entity.set_pose(sapien.Pose(pose))
        scene.update_render()
        camera.take_picture()
        picture = (np.clip(camera.get_picture("Color")[..., :3], 0, 1) * 255).astype(np.uint8)
        pictures.append(np.asarray(Image.fromarray(picture).resize((size, size), Image.Resampling.LANCZOS)))
        scene.remove_entity(entity)
    return pictures


def contact_sheet(
    groups: Sequence[tuple[str, Sequence[ObjectModel]]], size: int = 132, groups_per_row: int = 2
) -> Image.Image:
    """One labelled strip a group (name, models), `groups_per_row` strips beside one another."""
    title, gap = 20, 8
    most = max(len(models) for _, models in groups)
    rows = -(-len(groups) // groups_per_row)
    sheet = Image.new("RGB", (groups_per_row * (most * size + gap) + gap, rows * (size + title + gap)), BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    pictures = iter(render([model for _, models in groups for model in models], size))
    for i, (name, models) in enumerate(groups):
        x = gap + (i % groups_per_row) * (most * size + gap)
        y = (i // groups_per_row) * (size + title + gap)
        draw.text((x + 2, y + 4), name.replace("_", " "), fill=(30, 30, 30), font=ImageFont.load_default(14))
        for j in range(len(models)):
            sheet.paste(Image.fromarray(next(pictures)), (x + j * size, y + title))
    return sheet
