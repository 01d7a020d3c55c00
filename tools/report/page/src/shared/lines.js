// SPDX-License-Identifier: Apache-2.0
// Lines several pixels wide: WebGL's own are one pixel wide.
import {LineMaterial} from 'three/addons/lines/LineMaterial.js';
import {LineSegments2} from 'three/addons/lines/LineSegments2.js';
import {LineSegmentsGeometry} from 'three/addons/lines/LineSegmentsGeometry.js';

// `points`: Vector3, two per line.
export function segments(points, width, more = {}) {
  const lines = new LineSegments2(new LineSegmentsGeometry(), new LineMaterial({linewidth: width, ...more}));
  lines.frustumCulled = false;
  setSegments(lines, points);
  return lines;
}

export function setSegments(lines, points) {
  lines.visible = points.length > 0;
  if (points.length === 0) return;
  lines.geometry.dispose();
  lines.geometry = new LineSegmentsGeometry();
  lines.geometry.setPositions(points.flatMap((point) => point.toArray()));
  if (lines.material.dashed) lines.computeLineDistances();
}

// Converts a b c to a b, b c.
export function chain(points) {
  return points.slice(1).flatMap((point, i) => [points[i], point]);
}
