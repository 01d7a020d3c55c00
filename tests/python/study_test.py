# SPDX-License-Identifier: Apache-2.0
"""Studies from Python draw the values of study files, and keep errors as results."""
import json
import subprocess

import fringeslam as fs
import numpy as np
import pytest


def test_values_depend_on_seed_trial_and_name_only():
    law = {"uniform": [0, 1]}
    one = fs.draw_trials({"a": law}, 10, seed=3)
    assert [t["a"] for t in fs.draw_trials({"a": law, "b": law}, 20, seed=3)][:10] == [t["a"] for t in one]
    assert [t["a"] for t in fs.draw_trials({"a": law}, 10, seed=4)] != [t["a"] for t in one]


def test_distributions():
    trials = fs.draw_trials(
        {
            "uniform": {"uniform": [2, 4]},
            "log": {"log_uniform": [1, 100]},
            "normal": {"normal": [5, 2]},
            "whole": {"uniform": [1, 6], "whole": True},
            "choice": {"choice": ["a", None, 3]},
            "grid": {"grid": [0, 1]},
        },
        4000,
    )
    column = {name: [t[name] for t in trials] for name in trials[0]}
    assert np.mean(column["uniform"]) == pytest.approx(3, abs=0.05)
    assert np.std(column["uniform"]) == pytest.approx(2 / np.sqrt(12), abs=0.03)
    assert np.mean(np.log10(column["log"])) == pytest.approx(1, abs=0.05)
    assert np.mean(column["normal"]) == pytest.approx(5, abs=0.15)
    assert np.std(column["normal"]) == pytest.approx(2, abs=0.1)
    assert set(column["whole"]) == set(range(1, 7))
    assert set(column["choice"]) == {"a", None, 3}
    assert column["grid"][:4] == [0, 1, 0, 1]
    assert len(set(column["seed"])) == len(trials)


def test_values_equal_those_of_a_study_file(root, program, tmp_path):
    (tmp_path / "study.yaml").write_text(
        f"name: flux\nscene: {root}/scenes/boxes_and_foam\ntrials: 3\nseed: 9\nviews: 1\n"
        "parameters:\n  light.ambient_lux: {uniform: [0, 1000]}\n"
    )
    subprocess.run([program, "study", "run", tmp_path / "study.yaml", "--out", tmp_path / "out"],
                   check=True, capture_output=True)  # fmt: skip
    lines = (tmp_path / "out/results.jsonl").read_text().splitlines()
    rows = sorted((json.loads(line) for line in lines), key=lambda row: row["trial"])
    drawn = fs.draw_trials({"light.ambient_lux": {"uniform": [0, 1000]}}, 3, seed=9)
    assert [row["seed"] for row in rows] == [trial["seed"] for trial in drawn]
    values = [float(row["values"]["light.ambient_lux"]) for row in rows]
    assert values == [trial["light.ambient_lux"] for trial in drawn]


@pytest.mark.parametrize(
    "law, message",
    [
        ({"uniform": [1]}, "two numbers"),
        ({"uniform": [2, 1]}, "ordered"),
        ({"log_uniform": [0, 1]}, "ordered"),
        ({"choice": []}, "at least one"),
        ({"gauss": [0, 1]}, "needs one of"),
        ({"uniform": [0, float("inf")]}, "finite"),
        ({"uniform": ["a", "b"]}, "not a number"),
        (3, "needs a dict"),
    ],
)
def test_wrong_parameters_are_errors_of_one_line(law, message):
    with pytest.raises(fs.Error, match=message) as error:
        fs.draw_trials({"a": law}, 1)
    assert "\n" not in str(error.value)


def test_errors_of_a_trial_are_results():
    def function(seed, a):
        if a > 0.5:
            raise fs.Error("too large")
        return {"double": 2 * a}

    rows = fs.study(function, {"a": {"uniform": [0, 1]}}, 50)
    assert {"error" in row for row in rows} == {True, False}
    for row in rows:
        assert row.get("error") == "too large" if row["a"] > 0.5 else row["double"] == 2 * row["a"]


def test_wilson_interval_covers_the_share():
    low, high = fs.wilson_interval(3, 10)
    assert low < 0.3 < high
    assert fs.wilson_interval(0, 0) == (0, 1)
