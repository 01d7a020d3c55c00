// SPDX-License-Identifier: Apache-2.0
// States what the run's folder contains and this page does not.
import {data} from '../shared/data.js';
import {byId} from '../shared/dom.js';
import {count, fixed} from '../shared/format.js';

export function showLeftOut() {
  const parts = [];
  const {pictures, rig, map, views} = data;
  if (pictures.every > 1) {
    parts.push(`Every ${pictures.every === 2 ? 'second' : pictures.every === 3 ? 'third' : `${pictures.every}th`} of ${count(views.length)} views has pictures in this page.`);
  }
  if (pictures.width_px > 0 && pictures.width_px < rig.width_px) {
    parts.push(`Pictures are downscaled from ${rig.width_px} to ${pictures.width_px} px in width.`);
  }
  if (map?.cell_mm > 0) {
    const whole = map.whole_triangles ? `${count(map.whole_triangles)} triangles` : `${count(map.whole_vertices)} points`;
    const kept = map.whole_triangles ? count(map.triangles) : count(map.vertices);
    parts.push(`The map is simplified from ${whole} to ${kept}, on a grid of ${fixed(map.cell_mm, 1)} mm; the complete map is in mesh.ply and mesh.glb.`);
  }
  byId('left-out').textContent = parts.join(' ') || 'The page contains all data of the run.';
}
