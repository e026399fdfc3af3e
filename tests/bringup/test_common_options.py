"""`esfo run --help` lists the options that users change most."""

import pytest

from esfo_bringup.cli import main
from esfo_bringup.settings import common_options


@pytest.mark.parametrize("command", ["run", "live"])
def test_help_lists_each_with_default_and_meaning(capsys, command):
    with pytest.raises(SystemExit) as stopped:
        main([command, "--help"])
    assert stopped.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    assert common_options()
    for leaf in common_options():
        assert f"{leaf.name} default {leaf.value}" in text
        assert leaf.meaning in text
