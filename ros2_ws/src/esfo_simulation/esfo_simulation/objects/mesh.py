"""Meshes of files as objects: any shape that a user has, in place of those of the catalogue."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

import numpy as np
import trimesh
from numpy.typing import NDArray

from esfo_core.errors import SimulationError
from esfo_simulation.objects.mesh_color import LOWEST, face_albedo
from esfo_simulation.render.surface import Model, Points

SUFFIXES = (".ply", ".obj", ".glb", ".stl")

Patchwork = Literal["none", "facets", "faces"]
Up = Literal["x", "y", "z"]

_PATCHES = (LOWEST, 0.95)
"""Range of the albedos of a patchwork."""


def read_mesh(
    path: Path,
    size_m: float | None = None,
    seed: int = 0,
    *,
    patchwork: Patchwork = "none",
    up: Up = "z",
    centered: bool = True,
) -> Model:
    """Read a mesh file as an object: all the meshes of its scene as one, with the spin axis along z.

    path: .ply, .obj, .glb or .stl, taken as metres. size_m: scale it to this largest extent. patchwork: albedos at
    random, drawn with `seed`, in place of the file's colours, for each flat piece (facets) or each face. up: the file's
    axis that becomes z. centered: move the centre of its bounding box to the origin.

    Without a patchwork the albedo is the luminance of the file's colours; a mesh without colours gets one albedo, 0.6,
    and has no corners but those of its shape. A surface that is not closed is seen from both sides; faces without area
    are left out.

    Raises SimulationError for a file that is missing, of another form or damaged, without faces, with a vertex that is
    not finite, without area, and for an impossible size.
    """
    if patchwork not in get_args(Patchwork):
        raise SimulationError(f"patchwork is {patchwork!r}; choose from {', '.join(get_args(Patchwork))}")
    if up not in get_args(Up):
        raise SimulationError(f"up is {up!r}; choose from {', '.join(get_args(Up))}")
    if size_m is not None and not 0 < size_m < np.inf:
        raise SimulationError(f"{path}: a size of {size_m} m is not positive and finite")
    vertices, faces, albedo = _gather(path)
    mesh, kept = _welded(path, vertices, faces)
    albedo = albedo[kept] if patchwork == "none" else _patches(mesh, patchwork, np.random.default_rng(seed))
    vertices = np.roll(mesh.vertices, "zyx".index(up), axis=1)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    scale = 1.0 if size_m is None else size_m / float((high - low).max())
    vertices = scale * (vertices - (low + high) / 2 if centered else vertices)
    return _two_sided(mesh, vertices, albedo)


def _gather(path: Path) -> tuple[Points, NDArray[np.int64], Points]:
    """Read the meshes of the file's scene, each in its place: vertices (V, 3), faces (F, 3) and albedo (F,)."""
    if path.suffix.lower() not in SUFFIXES:
        raise SimulationError(f"{path}: unknown suffix {path.suffix!r}; known: {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise SimulationError(f"{path}: no such file")
    try:
        scene = trimesh.load_scene(path, process=False)
        meshes = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
        albedos = [face_albedo(mesh, linear=path.suffix.lower() == ".glb") for mesh in meshes]
    except ImportError as error:  # only to guess an encoding
        raise SimulationError(f"{path}: not a readable mesh (damaged, or text that is not UTF-8)") from error
    except Exception as error:  # of damaged files the readers raise anything, even UnboundLocalError
        reason = (str(error).splitlines() or [""])[0]
        raise SimulationError(f"{path}: not a readable mesh ({type(error).__name__}: {reason})") from error
    if not meshes:
        raise SimulationError(f"{path}: no faces")
    if any(mesh.vertices.ndim != 2 or mesh.vertices.shape[1] != 3 for mesh in meshes):
        raise SimulationError(f"{path}: not a readable mesh (its vertices are not points in space)")
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([np.asarray(mesh.vertices, np.float64) for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)])
    return vertices, np.asarray(faces), np.concatenate(albedos)


def _welded(path: Path, vertices: Points, faces: NDArray[np.int64]) -> tuple[trimesh.Trimesh, NDArray[np.bool_]]:
    """Join equal vertices and leave out faces without area; return the mesh and which faces (F,) it has kept."""
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise SimulationError(f"{path}: its faces name vertices {faces.min()} to {faces.max()} of {len(vertices)}")
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        k = int(np.argmin(finite))
        raise SimulationError(f"{path}: vertex {k} is {vertices[k].tolist()}, not finite")
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # Products of differences of coordinates are exact to about this; less area has no direction.
    kept = area > 4 * np.finfo(np.float64).eps * np.abs(vertices).max() ** 2
    if not kept.any():
        raise SimulationError(f"{path}: its {len(faces)} faces have no area")
    # Only what is equal to the bit: any tolerance would be too wide for some unit of length.
    distinct, index = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    return trimesh.Trimesh(distinct, index.reshape(-1)[faces[kept]], process=False), kept


def _patches(mesh: trimesh.Trimesh, patchwork: Patchwork, rng: np.random.Generator) -> Points:
    """Draw an albedo for each face (F,); the faces of a flat piece (facets) share one."""
    albedo = rng.uniform(*_PATCHES, len(mesh.faces))
    if patchwork == "facets":
        for piece in mesh.facets:
            albedo[piece] = albedo[min(piece)]
    return np.asarray(albedo)


def _two_sided(mesh: trimesh.Trimesh, vertices: Points, albedo: Points) -> Model:
    """Turn the faces of a closed surface outwards; give each face of any other a second one that looks back."""
    if mesh.is_watertight and mesh.is_winding_consistent:
        trimesh.repair.fix_inversion(mesh, multibody=True)
        return Model(vertices, mesh.faces.astype(np.int32), albedo)
    faces = np.vstack([mesh.faces, mesh.faces[:, ::-1]]).astype(np.int32)
    return Model(vertices, faces, np.tile(albedo, 2))
