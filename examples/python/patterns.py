# SPDX-License-Identifier: Apache-2.0
"""Designs fringe patterns with a Gray code and writes the projector's images."""
import fringeslam as fs

sequence = fs.design_patterns(1920, 1080, [18], steps=4, gray="complementary", white_black=True)
for i, image in enumerate(sequence.images()):
    fs.write_image(f"pattern_{i:02d}.png", image)
print(len(sequence), "patterns of", sequence.width, "x", sequence.height, "px")
