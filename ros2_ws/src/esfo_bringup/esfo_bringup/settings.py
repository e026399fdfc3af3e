"""Options of a whole run: those of the front-end and the back-end, with one preset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from esfo_backend.options import PRESETS as BACKEND_PRESETS
from esfo_backend.options import BackendOptions
from esfo_core.errors import OptionError
from esfo_core.options import OptionField, common_fields, fields_of, replace
from esfo_core.recordings import ReadingOptions
from esfo_frontend.options import PRESETS as FRONTEND_PRESETS
from esfo_frontend.options import FrontendOptions, check_options


@dataclass(frozen=True)
class RunSettings:
    """All options that a result depends on, besides the recording and the camera."""

    frontend: FrontendOptions
    backend: BackendOptions


@dataclass(frozen=True)
class Assignments:
    """Values of options by name, divided by the stage that has the option."""

    reading: dict[str, object]
    frontend: dict[str, object]
    backend: dict[str, object]


def common_options() -> list[OptionField]:
    """Return the options of the front-end and the back-end that users change most."""
    return [*common_fields(FrontendOptions()), *common_fields(BackendOptions())]


def share_out(values: Mapping[str, object]) -> Assignments:
    """Assign each value to the stages that have the option. Raises OptionError for an unknown name."""
    owners = [
        {leaf.name for leaf in fields_of(options)}
        for options in (ReadingOptions(), FrontendOptions(), BackendOptions())
    ]
    for name in values:
        if not any(name in owned for owned in owners):
            known = ", ".join(sorted(set.union(*owners)))
            raise OptionError(f"unknown option {name!r}; known: {known}")
    return Assignments(*({k: v for k, v in values.items() if k in owned} for owned in owners))


def settings_for(preset: str, values: Mapping[str, object]) -> RunSettings:
    """Return the settings of a preset with single options changed; options of reading are ignored.

    Raises OptionError for an unknown preset or option, or a value that does not fit.
    """
    if preset not in FRONTEND_PRESETS:
        raise OptionError(f"preset is {preset!r}; choose from {', '.join(FRONTEND_PRESETS)}")
    changed = share_out(values)
    frontend = replace(FRONTEND_PRESETS[preset], changed.frontend)
    check_options(frontend)
    return RunSettings(frontend, replace(BACKEND_PRESETS[preset], changed.backend))
