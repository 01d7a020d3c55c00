# SPDX-License-Identifier: Apache-2.0
"""Monte Carlo studies of Python functions."""

from typing import Any, Callable, Dict, List

from . import _fringeslam as fs


def study(
    function: Callable[..., Dict[str, Any]], parameters: Dict[str, Dict[str, Any]], trials: int, seed: int = 1
) -> List[Dict[str, Any]]:
    """Calls `function` with randomly drawn keyword arguments and returns one dict for each trial.

    `parameters` has the form of draw_trials(); `function` also receives `seed` for the scene. A row contains 'trial',
    the arguments, and the values that the function returned, or 'error' if it raised fringeslam.Error.
    """
    rows = []
    for trial, arguments in enumerate(fs.draw_trials(parameters, trials, seed)):
        row: Dict[str, Any] = {"trial": trial, **arguments}
        try:
            row.update(function(**arguments))
        except fs.Error as error:
            row["error"] = str(error)
        rows.append(row)
    return rows
