"""Flat clusters by the package `hdbscan`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from esfo_frontend.options import ClusterOptions


def labels(points: NDArray[np.float64], options: ClusterOptions) -> NDArray[np.int32]:
    """Return the cluster (N,) of each point (N, 3), -1 for noise."""
    from hdbscan import HDBSCAN  # loads all of scikit-learn, a second that only this option needs

    model = HDBSCAN(
        min_cluster_size=options.min_size,
        cluster_selection_epsilon=options.epsilon,
        approx_min_span_tree=False,
        core_dist_n_jobs=1,
    )
    return np.asarray(model.fit_predict(points), np.int32)
