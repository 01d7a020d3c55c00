// SPDX-License-Identifier: Apache-2.0
// Warm regions found by a thermal camera, victims first: a table with the reasons, and marks in the map.
import * as THREE from 'three';
import {inks} from '../shared/colours.js';
import {data} from '../shared/data.js';
import {byId, element} from '../shared/dom.js';
import {fixed} from '../shared/format.js';
import {head, scroller} from '../shared/tables.js';
import {placeOf, store} from './store.js';

const kLeastRadius = 0.012; // m, of a mark

const things = [...(data.warm_things ?? [])].sort((a, b) => Number(b.victim) - Number(a.victim));

function row(thing) {
  const place = thing.position_m.map((metres) => fixed(metres, 2)).join(', ');
  const look = element('button', {type: 'button', class: 'chooser', onclick: () => store.choose(placeOf(thing.best_view))},
    String(thing.best_view));
  return element('tr', {class: thing.victim ? 'victim' : ''},
    element('th', {scope: 'row'}, thing.victim ? 'victim?' : 'not a victim'),
    element('td', {}, `${fixed(thing.warmest_c, 1)}`),
    element('td', {}, fixed(thing.area_cm2, 0)),
    element('td', {}, place),
    element('td', {}, `${thing.skin_views} of ${thing.views}`),
    element('td', {}, look),
    element('td', {class: 'words'}, thing.reason));
}

export function showWarmThings() {
  if (data.warm_things === null) return;
  const section = byId('warm');
  section.hidden = false;
  if (things.length === 0) {
    section.append(element('p', {class: 'quiet'}, 'Nothing was warmer than its surroundings.'));
    return;
  }
  const titles = ['class', '°C', 'cm²', 'position in the map, m', 'views as skin', 'best view', 'reason'];
  section.append(scroller('Warm regions', element('table', {}, head(titles), element('tbody', {}, ...things.map(row)))));
}

// Marks the regions with rings, victims in the alarm colour; null if there are none.
export function warmMarks() {
  if (things.length === 0) return null;
  const group = new THREE.Group();
  const marks = things.map((thing) => {
    const mark = new THREE.Mesh(
      new THREE.SphereGeometry(Math.max(kLeastRadius, thing.extent_m), 20, 12),
      new THREE.MeshBasicMaterial({wireframe: true, transparent: true, opacity: thing.victim ? 0.7 : 0.25}));
    mark.position.set(...thing.position_m);
    group.add(mark);
    return [mark, thing.victim];
  });
  return {
    group,
    colour(dark) {
      const ink = inks(dark);
      for (const [mark, victim] of marks) mark.material.color.set(victim ? ink.lost : ink.third);
    },
  };
}
