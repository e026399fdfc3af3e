"""Mesh files as objects: every form, colours to albedo, winding, and each thing that can be wrong with a file."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest
import trimesh
from PIL import Image

from esfo_core.errors import SimulationError
from esfo_simulation.objects.mesh import SUFFIXES, read_mesh
from esfo_simulation.objects.mesh_color import HIGHEST, LOWEST, UNCOLORED

LUMINANCE = [0.2126, 0.7152, 0.0722]
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def box():
    """A box of 1 x 2 x 3 m with its centre at (10, 20, 30) m."""
    mesh = trimesh.creation.box((1, 2, 3))
    mesh.apply_translation([10, 20, 30])
    return mesh


def write(path, mesh):
    mesh.export(path)
    return path


def volume(model):
    """Signed volume: positive where the faces of a closed surface look outwards."""
    a, b, c = (model.vertices[model.faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".PLY"])
def test_every_form_is_read(tmp_path, suffix):
    path = tmp_path / f"box{suffix}"
    path.write_bytes(write(tmp_path / f"box{suffix.lower()}", box()).read_bytes())
    model = read_mesh(path)
    assert len(model.vertices) == 8
    assert len(model.faces) == 12
    np.testing.assert_allclose(model.vertices.min(axis=0), [-0.5, -1, -1.5], atol=1e-6)
    np.testing.assert_allclose(model.vertices.max(axis=0), [0.5, 1, 1.5], atol=1e-6)
    assert volume(model) == pytest.approx(6, rel=1e-6)
    assert (model.albedo == UNCOLORED).all()
    assert model.faces.dtype == np.int32


def test_size_and_place(tmp_path):
    path = write(tmp_path / "box.ply", box())
    np.testing.assert_allclose(np.ptp(read_mesh(path, 0.3).vertices, axis=0), [0.1, 0.2, 0.3])
    model = read_mesh(path, centered=False)
    np.testing.assert_allclose(model.vertices.min(axis=0), [9.5, 19, 28.5])


@pytest.mark.parametrize(("up", "extents"), [("x", [2, 3, 1]), ("y", [3, 1, 2]), ("z", [1, 2, 3])])
def test_the_chosen_axis_goes_up(tmp_path, up, extents):
    model = read_mesh(write(tmp_path / "box.ply", box()), up=up)
    np.testing.assert_allclose(np.ptp(model.vertices, axis=0), extents)
    assert volume(model) == pytest.approx(6)  # turned, not mirrored
    raised = read_mesh(write(tmp_path / "box.ply", box()), up=up, centered=False)
    assert raised.vertices[:, 2].mean() == pytest.approx({"x": 10, "y": 20, "z": 30}[up])


def test_a_unit_of_length_changes_nothing_but_the_scale(tmp_path):
    mesh = trimesh.creation.icosphere(2)
    mesh.vertices *= 1e-9
    tiny = read_mesh(write(tmp_path / "tiny.glb", mesh), 1.0)
    assert len(tiny.faces) == len(mesh.faces)
    assert np.isfinite(tiny.normals()).all()


def test_a_scene_is_one_mesh_with_every_part_in_its_place(tmp_path):
    scene = trimesh.Scene()
    for k in range(3):
        part = trimesh.creation.box((1, 1, 1))
        part.visual.vertex_colors = [60 * (k + 1)] * 3 + [255]
        scene.add_geometry(part, transform=trimesh.transformations.translation_matrix([4 * k, 0, 0]))
    model = read_mesh(write(tmp_path / "three.glb", scene))
    assert len(model.faces) == 36
    assert np.ptp(model.vertices[:, 0]) == pytest.approx(9)
    for k in range(3):
        part = np.abs(model.vertices[model.faces][:, :, 0].mean(axis=1) - (4 * k - 4)) < 1
        # colours of vertices are linear in glTF
        np.testing.assert_allclose(model.albedo[part], 60 * (k + 1) / 255)


def srgb(byte):
    c = byte / 255
    return c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4


def test_colours_of_faces(tmp_path):
    mesh = box()
    colors = np.random.default_rng(1).integers(0, 256, (12, 4)).astype(np.uint8)
    colors[0, :3], colors[1, :3] = 0, 255
    mesh.visual.face_colors = colors
    model = read_mesh(write(tmp_path / "box.ply", mesh))
    expected = np.vectorize(srgb)(colors[:, :3]) @ LUMINANCE
    np.testing.assert_allclose(model.albedo, np.clip(expected, LOWEST, HIGHEST))
    assert model.albedo[0] == 0.02
    assert model.albedo[1] == 0.98


def test_colours_of_vertices(tmp_path):
    path = tmp_path / "triangle.obj"
    path.write_text("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n")
    assert read_mesh(path).albedo[0] == pytest.approx(sum(LUMINANCE) / 3)
    path.write_text("v 0 0 0 0.2 0.2 0.2\nv 1 0 0 0.2 0.2 0.2\nv 0 1 0 0.2 0.2 0.2\nf 1 2 3\n")
    assert read_mesh(path).albedo[0] == pytest.approx(srgb(51))


def half_and_half():
    """A unit square with its diagonal; the texture is black on the left half and white on the right one."""
    mesh = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    texture = np.zeros((64, 64, 3), np.uint8)
    texture[:, 32:] = 255
    return mesh, [[0, 0], [1, 0], [1, 1], [0, 1]], Image.fromarray(texture)


@pytest.mark.parametrize("suffix", [".obj", ".glb"])
def test_textures(tmp_path, suffix):
    mesh, uv, image = half_and_half()
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, baseColorFactor=[128, 128, 128, 255])
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    albedo = read_mesh(write(tmp_path / f"square{suffix}", mesh)).albedo[:2]
    # The diagonal leaves three quarters of the lower right triangle in the white half; 16 samples tell to 1/8.
    # In glTF the base colour is linear and multiplies the texture; in OBJ the texture stands for itself.
    factor = 128 / 255 if suffix == ".glb" else 1.0
    np.testing.assert_allclose(albedo, np.array([0.75, 0.25]) * factor, atol=0.125 * factor)
    assert albedo.sum() == pytest.approx(factor, abs=1e-6)


def test_materials_without_texture(tmp_path):
    (tmp_path / "paint.mtl").write_text("newmtl grey\nKd 0.5 0.5 0.5\n")
    path = tmp_path / "triangle.obj"
    path.write_text(f"mtllib paint.mtl\nusemtl grey\n{TRIANGLE}")
    # trimesh keeps colours as bytes: half a step of 255 is at most 0.4 % of this luminance
    assert read_mesh(path).albedo[0] == pytest.approx(srgb(127.5), rel=0.01)
    mesh = box()
    mesh.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[51, 51, 51, 255])
    )
    assert read_mesh(write(tmp_path / "box.glb", mesh)).albedo[0] == pytest.approx(0.2)


def test_a_closed_surface_looks_outwards_however_it_is_wound(tmp_path):
    inverted, upright = box(), box()
    inverted.invert()
    inverted.apply_translation([5, 0, 0])
    both = trimesh.util.concatenate([inverted, upright])
    model = read_mesh(write(tmp_path / "both.stl", both))
    assert len(model.faces) == 24
    assert volume(model) == pytest.approx(12)


@pytest.mark.parametrize("broken", ["open", "mixed"])
def test_any_other_surface_is_seen_from_both_sides(tmp_path, broken):
    mesh = box()
    faces = np.array(mesh.faces)
    if broken == "mixed":
        faces[3] = faces[3, ::-1]
    else:
        faces = faces[1:]
    mesh.visual = trimesh.visual.ColorVisuals()
    model = read_mesh(
        write(tmp_path / "box.ply", trimesh.Trimesh(mesh.vertices, faces, process=False)), patchwork="faces"
    )
    n = len(faces)
    assert len(model.faces) == 2 * n
    np.testing.assert_allclose(model.normals()[n:], -model.normals()[:n])
    np.testing.assert_array_equal(model.albedo[n:], model.albedo[:n])


def test_patchwork(tmp_path):
    path = write(tmp_path / "box.stl", box())
    by_face, by_facet = (read_mesh(path, seed=4, patchwork=form) for form in ("faces", "facets"))
    assert len(np.unique(by_face.albedo)) == 12
    assert len(np.unique(by_facet.albedo)) == 6
    for normal in np.vstack([np.eye(3), -np.eye(3)]):
        side = by_facet.normals() @ normal > 0.9
        assert side.sum() == 2
        assert np.ptp(by_facet.albedo[side]) == 0
    assert ((by_face.albedo >= LOWEST) & (by_face.albedo <= HIGHEST)).all()
    np.testing.assert_array_equal(read_mesh(path, seed=4, patchwork="facets").albedo, by_facet.albedo)
    assert not np.array_equal(read_mesh(path, seed=5, patchwork="facets").albedo, by_facet.albedo)


def test_faces_without_area_are_left_out(tmp_path):
    path = tmp_path / "triangle.obj"
    path.write_text(TRIANGLE + "v 2 0 0\nf 1 2 4\nf 1 1 2\n")
    model = read_mesh(path)
    assert len(model.faces) == 2  # one, from both sides
    assert np.isfinite(model.normals()).all()


WRONG = {
    "suffix": ("a.step", b"", "unknown suffix '.step'; known: .ply, .obj, .glb, .stl"),
    "no suffix": ("a", b"", "unknown suffix ''"),
    "only points": ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
    "empty": ("a.stl", b"", "no faces"),
    "not finite": ("a.obj", TRIANGLE.replace("1 0 0", "1 nan 0").encode(), "vertex 1 is [1.0, nan, 0.0], not finite"),
    "a line": ("a.obj", b"v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n", "its 1 faces have no area"),
    "no such vertex": ("a.obj", TRIANGLE.replace("1 2 3", "1 2 9").encode(), "not a readable mesh"),
    "noise": ("a.glb", bytes(range(256)), "not a readable mesh (ValueError: incorrect header on GLB file)"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_said_in_a_line(tmp_path, case):
    name, content, message = WRONG[case]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(SimulationError) as caught:
        read_mesh(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert message in text
    assert "\n" not in text


@pytest.mark.skipif(find_spec("charset_normalizer") is not None, reason="a package that guesses encodings is there")
def test_text_in_another_encoding(tmp_path):
    path = tmp_path / "a.obj"
    path.write_bytes("# Größe\n".encode("latin-1") + TRIANGLE.encode())
    with pytest.raises(SimulationError, match="text that is not UTF-8"):
        read_mesh(path)


def test_files_that_are_not_there(tmp_path):
    for path in (tmp_path / "gone.ply", tmp_path):
        with pytest.raises(SimulationError, match=r"no such file|unknown suffix"):
            read_mesh(path)


def test_indices_beyond_the_vertices_in_binary_files(tmp_path):
    path = write(tmp_path / "box.ply", box())
    content = bytearray(path.read_bytes())
    content[-4:] = (1000).to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(SimulationError, match=r"box\.ply: "):
        read_mesh(path)


@pytest.mark.parametrize("size", [0.0, -1.0, np.inf, np.nan])
def test_impossible_sizes(tmp_path, size):
    with pytest.raises(SimulationError, match="not positive and finite"):
        read_mesh(write(tmp_path / "box.ply", box()), size)


def test_choices_outside_the_list(tmp_path):
    path = write(tmp_path / "box.ply", box())
    with pytest.raises(SimulationError, match="patchwork is 'all'; choose from none, facets, faces"):
        read_mesh(path, patchwork="all")
    with pytest.raises(SimulationError, match="up is 'w'; choose from x, y, z"):
        read_mesh(path, up="w")
