// SPDX-License-Identifier: Apache-2.0
// The map in 3D, with the camera's paths and frusta.
import * as THREE from 'three';
import {colourBar} from '../shared/colour_bar.js';
import {inks} from '../shared/colours.js';
import {data} from '../shared/data.js';
import {byId, checkbox, choice, element} from '../shared/dom.js';
import {count} from '../shared/format.js';
import {Orbit} from '../shared/orbit.js';
import {fitted, floorGrid, legend, rendererOn, squareSize} from '../shared/stage.js';
import {theme} from '../shared/theme.js';
import {mapModel} from './map_model.js';
import {errorScale, paths, positions} from './paths.js';
import {store} from './store.js';
import {warmMarks} from './warm_things.js';

function notice(text) {
  byId('scene-notice').textContent = text;
  byId('scene-notice').hidden = false;
}

function lights(camera) {
  const key = new THREE.DirectionalLight(0xffffff, 1.5);
  key.position.set(0.4, 0.7, 1);
  camera.add(key);
  return [new THREE.AmbientLight(0xffffff, 1.9), camera];
}

function showMapBar(colouring) {
  byId('map-bar').replaceChildren(...(colouring.bar ? [colourBar(...colouring.bar)] : []));
}

export async function showScene() {
  const canvas = byId('scene');
  const cameras = positions();
  canvas.setAttribute('aria-label', `3D map of ${data.name} with the camera's path`);
  if (!data.map && cameras.length === 0) return notice('No view was tracked: there is no map.');
  const renderer = rendererOn(canvas);
  if (!renderer) return notice('This browser has no WebGL 2: the map cannot be shown. See mesh.glb next to the report.');

  const model = data.map ? await mapModel() : null;
  const box = model?.box ?? new THREE.Box3().setFromPoints(cameras).expandByScalar(0.1);
  const scale = errorScale(box.getSize(new THREE.Vector3()).length());
  const drawn = paths(scale);
  const {grid, square} = floorGrid(box);
  const warm = warmMarks();

  let asked = false;
  const redraw = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(draw);
  };
  const orbit = new Orbit(canvas, box, cameras, redraw);
  const scene = new THREE.Scene();
  scene.add(...lights(orbit.camera), drawn.group, grid);
  if (warm) scene.add(warm.group);
  if (model) scene.add(...[model.surface, model.points].filter(Boolean));

  function draw(now) {
    asked = false;
    const moves = orbit.update(now);
    renderer.render(scene, orbit.camera);
    canvas.dataset.drawn = 'true';
    if (moves) redraw();
  }

  const controls = byId('scene-controls');
  const shown = (label, object, on = true) =>
    checkbox(label, on, (checked) => {
      object.visible = checked;
      redraw();
    });
  if (model) {
    const names = Object.entries(model.colourings).map(([name, {label}]) => [name, label]);
    controls.append(choice('colour', names, (name) => {
      model.colourBy(name);
      showMapBar(model.colourings[name]);
      redraw();
    }));
    model.points.visible = !model.surface;
    if (model.surface) {
      controls.append(choice('show as', [['surface', 'surface'], ['points', 'points']], (kind) => {
        model.surface.visible = kind === 'surface';
        model.points.visible = kind === 'points';
        redraw();
      }));
    }
  }
  controls.append(shown('frusta', drawn.frusta), shown('estimated path', drawn.estimate));
  if (data.has_truth) controls.append(shown('true path', drawn.truth));
  if (scale) controls.append(shown(`errors × ${count(scale)}`, drawn.errors, false));
  controls.append(shown('grid', grid));
  if (warm) controls.append(shown('warm regions', warm.group));
  const look = () => {
    const view = data.views[store.view];
    const pose = view.pose ?? view.true_pose;
    if (pose) orbit.flyTo(pose, (data.pictures.near_m + data.pictures.far_m) / 2);
  };
  controls.append(
    element('button', {type: 'button', class: 'button', id: 'look', onclick: look}, 'Camera view'),
    element('button', {type: 'button', class: 'button', id: 'reset', onclick: () => orbit.reset()}, 'Reset'));
  canvas.addEventListener('keydown', (event) => {
    if (event.key === 'v' || event.key === 'V') look();
  });

  const entries = [['estimate', 'estimated path']];
  if (data.has_truth) entries.push(['truth', 'true path', 'dashed']);
  if (warm) entries.push(['lost', 'victim?'], ['third', 'warm, not a victim']);
  entries.push(['chosen', 'this view'], ['floor', `squares of ${squareSize(square)}`]);
  legend(entries);

  theme.on((dark) => {
    const ink = inks(dark);
    scene.background = new THREE.Color(ink.paper);
    grid.material.color.set(ink.floor);
    drawn.colour();
    warm?.colour(dark);
    redraw();
  });
  store.onView((place) => {
    drawn.choose(data.views[place]);
    redraw();
  });
  fitted(renderer, canvas, orbit);
}
