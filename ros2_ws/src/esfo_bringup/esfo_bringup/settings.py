"""Options of a whole run: those of the front-end and the back-end under one preset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from esfo_backend.options import PRESETS as BACKEND_PRESETS
from esfo_backend.options import BackendOptions
from esfo_core.errors import OptionError
from esfo_core.options import fields_of, replace
from esfo_frontend.options import PRESETS as FRONTEND_PRESETS
from esfo_frontend.options import FrontendOptions, check_options


@dataclass(frozen=True)
class RunSettings:
    """Everything that decides a result besides the recording and the camera."""

    frontend: FrontendOptions
    backend: BackendOptions


def settings_for(preset: str, values: Mapping[str, str]) -> RunSettings:
    """Return the settings of a preset with single options changed; an option's name says whose it is.

    Raises OptionError for an unknown preset or option, or a value that does not fit.
    """
    if preset not in FRONTEND_PRESETS:
        raise OptionError(f"preset is {preset!r}; choose from {', '.join(FRONTEND_PRESETS)}")
    frontend, backend = FRONTEND_PRESETS[preset], BACKEND_PRESETS[preset]
    of_frontend = {leaf.name for leaf in fields_of(frontend)}
    of_backend = {leaf.name for leaf in fields_of(backend)}
    for name in values:
        if name not in of_frontend | of_backend:
            raise OptionError(f"unknown option {name!r}; known: {', '.join(sorted(of_frontend | of_backend))}")
    frontend = replace(frontend, {k: v for k, v in values.items() if k in of_frontend})
    check_options(frontend)
    return RunSettings(frontend, replace(backend, {k: v for k, v in values.items() if k in of_backend}))
