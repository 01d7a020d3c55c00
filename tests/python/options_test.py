# SPDX-License-Identifier: Apache-2.0
"""Options have the names, defaults and ranges of the settings."""
import json
import pickle
import re
import subprocess

import fringeslam as fs
import pytest


def program_settings(program):
    """Yields (stage, name, default as text) of each setting."""
    text = subprocess.run([program, "settings"], check=True, capture_output=True, text=True).stdout
    for section in text.split("\n## ")[1:]:
        stage = section.split("\n", 1)[0]
        for name, default in re.findall(r"^\| `(\w+)` \| `([^`]*)` \|", section, re.MULTILINE):
            yield stage, name, default


def test_defaults_are_those_of_the_program(program):
    options = fs.PipelineOptions().to_dict()
    options["render"] = fs.RenderOptions().to_dict()
    compared = 0
    for stage, name, default in program_settings(program):
        if stage in options:
            value = options[stage][name]
            text = default if isinstance(value, str) else json.loads(default)
            assert value == text, f"{stage}.{name}"
            compared += 1
    assert compared == sum(len(stage) for stage in options.values())


def test_stages_are_changed_by_dicts_and_objects():
    options = fs.PipelineOptions(icp={"stride": 2}, decode=fs.DecodeOptions(unwrapping="gray"))
    assert options.icp.stride == 2
    assert options.decode.unwrapping == "gray"
    options.icp.stride = 4
    assert options.icp.stride == 4
    options.icp = {"stride": 8}
    assert options.icp == fs.IcpOptions(stride=8)
    assert options != fs.PipelineOptions()


def test_options_can_be_pickled():
    options = fs.PipelineOptions(icp={"stride": 2}, mapping={"every_view": True})
    assert pickle.loads(pickle.dumps(options)) == options
    assert pickle.loads(pickle.dumps(options.icp)) == options.icp


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: fs.DecodeOptions(unwraping="gray"), "decode.unwraping.*did you mean 'unwrapping'"),
        (lambda: fs.DecodeOptions(unwrapping="grey"), "decode.unwrapping.*'grey' is not one of auto"),
        (lambda: fs.DecodeOptions(unwrapping=1), "must be a string"),
        (lambda: fs.DecodeOptions(saturation=2), "decode.saturation"),
        (lambda: fs.DecodeOptions(saturation=float("nan")), "decode.saturation"),
        (lambda: fs.DecodeOptions(steps=1.5), "whole number"),
        (lambda: fs.DecodeOptions(steps="3"), "must be a number"),
        (lambda: fs.MappingOptions(every_view=1), "True or False"),
        (lambda: fs.PipelineOptions(icpp={}), "unknown stage 'icpp'.*did you mean 'icp'"),
    ],
)
def test_wrong_options_are_errors_of_one_line(make, message):
    with pytest.raises(fs.Error, match=message) as error:
        make()
    assert "\n" not in str(error.value)


def test_a_rejected_value_leaves_the_options_unchanged():
    options = fs.IcpOptions()
    with pytest.raises(fs.Error):
        options.max_distance_m = -1
    assert options == fs.IcpOptions()
