"""Options of a run reach the part that they belong to."""

import pytest

from esfo_backend.options import PRESETS as BACKEND
from esfo_bringup.settings import settings_for
from esfo_core.errors import OptionError
from esfo_core.options import fields_of
from esfo_frontend.options import PRESETS as FRONTEND


def test_names_of_both_parts_never_meet():
    frontend = {leaf.name for leaf in fields_of(FRONTEND["default"])}
    backend = {leaf.name for leaf in fields_of(BACKEND["default"])}
    assert not frontend & backend


def test_presets_are_the_same_for_both_parts():
    assert set(FRONTEND) == set(BACKEND) == {"default", "paper"}


def test_options_go_where_they_belong():
    settings = settings_for("paper", {"join.radius": "7", "graph.prune_px": "4"})
    assert settings.frontend.join.radius == 7.0
    assert settings.frontend.time_scale == FRONTEND["paper"].time_scale
    assert settings.backend.graph.prune_px == 4.0
    assert settings.backend.initialisation.method == "colmap"


def test_contradictions_are_refused():
    with pytest.raises(OptionError, match="half"):
        settings_for("default", {"clusters.chunk": "10", "clusters.shared": "8"})
    with pytest.raises(OptionError, match="preset"):
        settings_for("best", {})
