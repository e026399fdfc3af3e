"""From the colours of a mesh file to one albedo per face."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from esfo_simulation.render.surface import Points

UNCOLORED = 0.6
"""Albedo of a mesh that has no colours."""

LOWEST, HIGHEST = 0.02, 0.98
"""Range of albedo: nothing is quite black or white, and log intensity stays finite."""

_SAMPLES_PER_EDGE = 4


def face_albedo(mesh: trimesh.Trimesh, linear: bool) -> Points:
    """Return the albedo of each face (F,): the luminance of its colour, `UNCOLORED` where the mesh has none.

    linear: colours of vertices and materials are linear, as glTF 2.0 has them (sections 3.7.2.1 and 3.9.2); else they
    are sRGB, as textures always are. A texture is sampled at 16 points of each face, colours of vertices are averaged
    over the face's corners, both as linear luminance. Opacity is ignored.
    """
    visual: Any = mesh.visual
    if isinstance(visual, trimesh.visual.TextureVisuals):
        found = _material(visual, mesh.faces, linear)
    elif visual.kind == "face":
        found = _luminance(visual.face_colors, linear)
    elif visual.kind == "vertex":
        found = _luminance(visual.vertex_colors, linear)[mesh.faces].mean(axis=1)
    else:
        found = None
    if found is None:
        return np.full(len(mesh.faces), UNCOLORED)
    return np.clip(found, LOWEST, HIGHEST)


def _luminance(colors: ArrayLike, linear: bool) -> Points:
    """Relative luminance (N,) of 8-bit RGBA colours (N, 4), decoded by IEC 61966-2-1 (sRGB) unless they are linear."""
    rgb = np.asarray(trimesh.visual.color.to_rgba(colors))[..., :3] / 255
    if not linear:
        rgb = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return np.asarray(rgb @ [0.2126, 0.7152, 0.0722])


def _material(visual: Any, faces: NDArray[np.int64], linear: bool) -> Points | None:
    """Luminance (F,) of texture, base colour and vertex colours of a material; None where it has none of them."""
    material = visual.material
    parts = []
    if isinstance(material, trimesh.visual.material.PBRMaterial):
        image, base = material.baseColorTexture, material.baseColorFactor
    else:
        image, base = getattr(material, "image", None), material.main_color
    if image is not None and visual.uv is not None:
        parts.append(_sample(image, np.asarray(visual.uv)[faces]))
    if base is not None and (linear or not parts):
        # glTF multiplies texture and base colour; in OBJ files a texture stands for itself.
        parts.append(np.full(len(faces), _luminance(base, linear)))
    colors = visual.vertex_attributes.get("color")
    if colors is not None:
        parts.append(_luminance(colors, linear)[faces].mean(axis=1))
    return np.asarray(np.prod(parts, axis=0)) if parts else None


def _sample(image: Any, corners: Points) -> Points:
    """Mean luminance (F,) of the texture within each face; corners: its texture coordinates (F, 3, 2)."""
    n = _SAMPLES_PER_EDGE
    # Middles of the n^2 congruent triangles into which a triangle divides, in thirds of a step.
    steps = [(3 * i + 1, 3 * j + 1) for i in range(n) for j in range(n - i)]
    steps += [(3 * i + 2, 3 * j + 2) for i in range(n - 1) for j in range(n - 1 - i)]
    weights = np.array([(u, v, 3 * n - u - v) for u, v in steps]) / (3 * n)
    uv = np.einsum("sk,fkd->fsd", weights, corners)
    colors = trimesh.visual.color.uv_to_color(uv.reshape(-1, 2), image)
    return np.asarray(_luminance(colors, linear=False).reshape(uv.shape[:2]).mean(axis=1))
