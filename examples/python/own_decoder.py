# SPDX-License-Identifier: Apache-2.0
"""Maps with a decoder written in NumPy: three steps per period, unwrapped from the coarsest period to the finest."""
import fringeslam as fs
import numpy as np

def decode(stack):  # -> projector column, px, and its standard deviation
    column = stack.patterns[0].period_px / 2  # the first period covers the projector
    for k in range(0, len(stack), 3):
        a, b, c = (image.astype(np.float32) for image in stack.images[k : k + 3])
        period = stack.patterns[k].period_px
        phase = np.arctan2(np.sqrt(3) * (a - c), 2 * b - a - c) % (2 * np.pi)
        fine = phase * period / (2 * np.pi) - 0.5
        column = fine + period * np.round((column - fine) / period)
    modulation = np.hypot(np.sqrt(3) * (a - c), 2 * b - a - c) / 3
    return np.where(modulation > 4, column, np.nan), 0.5 * period / (2 * np.pi) / np.maximum(modulation, 1)

scene = fs.load_scene("scenes/boxes_and_foam")
rig = fs.VirtualRig(scene)
pipeline = fs.Pipeline(rig.model, scene.patterns, front_end=decode)
print([view.result.tracking for view in fs.Driver(rig, pipeline)])
