import numpy as np
import trimesh

from esfo_core.point_cloud import write_points


def test_a_mesh_library_reads_the_points_that_were_written(tmp_path):
    points = np.random.default_rng(1).normal(size=(7, 3))
    write_points(tmp_path / "points.ply", points)
    read = trimesh.load(tmp_path / "points.ply")
    assert isinstance(read, trimesh.PointCloud)
    np.testing.assert_array_equal(read.vertices, points.astype(np.float32))
