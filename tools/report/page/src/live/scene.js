// SPDX-License-Identifier: Apache-2.0
// The growing map in 3D, with the robot in it.
import * as THREE from 'three';
import {colourBar} from '../shared/colour_bar.js';
import {inks} from '../shared/colours.js';
import {Detail} from '../shared/detail.js';
import {byId, checkbox, choice, element} from '../shared/dom.js';
import {Orbit} from '../shared/orbit.js';
import {fitted, floorGrid, legend, rendererOn, squareSize} from '../shared/stage.js';
import {theme} from '../shared/theme.js';
import {Clouds} from './clouds.js';
import {Robot} from './robot.js';
import {on, store} from './store.js';

const kGrown = 1.15;  // growth of the floor's extent that triggers a new floor

function notice(text) {
  byId('scene-notice').textContent = text;
  byId('scene-notice').hidden = text === '';
}

class Stage {
  constructor(canvas, renderer) {
    this.canvas = canvas;
    this.renderer = renderer;
    this.scene = new THREE.Scene();
    this.robot = new Robot();
    this.clouds = new Clouds(() => this.grow());
    this.detail = new Detail(() => this.redraw());
    this.floor = null;
    this.gridShown = true;
    this.asked = false;
    this.orbit = new Orbit(canvas, new THREE.Box3(new THREE.Vector3(-0.2, -0.2, -0.2), new THREE.Vector3(0.2, 0.2, 0.2)), [], () => this.redraw());
    this.scene.add(this.robot.group, this.clouds.group);
  }

  redraw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => {
      this.asked = false;
      const moves = this.orbit.update(now);
      const share = this.detail.begin();
      this.clouds.thin(share);
      this.renderer.render(this.scene, this.orbit.camera);
      this.detail.end(share, now);
      this.canvas.dataset.points = this.clouds.points;
      this.canvas.dataset.landmarks = this.robot.landmarks.geometry.getAttribute('position')?.count ?? 0;
      this.canvas.dataset.drawn = 'true';
      this.canvas.toggleAttribute('data-whole', share === 1 && this.clouds.clouds.length > 0 && this.clouds.clouds.length === store.keyframes.length);
      if (moves) this.redraw();
    });
  }

  restart() {
    this.clouds.restart();
    this.robot.restart();
    this.extent = null;
    this.orbit.touched = false;
    byId('map').hidden = !store.about.maps;
    byId('workspace').classList.toggle('alone', !store.about.maps);
    notice('Waiting for the first mapped view.');
  }

  update() {
    const before = this.robot.pose?.position;
    this.robot.update();
    const now = this.robot.pose?.position;
    if (this.following && before && now) this.orbit.moveBy(new THREE.Vector3(...now).sub(new THREE.Vector3(...before)));
    this.clouds.update();
    if (this.square && this.warm !== store.candidates.length > 0) this.explain();
    this.redraw();
  }

  // Called when the map has grown or changed.
  grow() {
    const box = this.clouds.box;
    if (box.isEmpty()) return;
    notice('');
    const bar = this.clouds.bar;
    byId('map-bar').replaceChildren(...(bar ? [colourBar(...bar)] : []));
    if (!this.extent || !this.extent.containsBox(box)) {
      this.extent = box.clone().expandByScalar(((kGrown - 1) / 2) * box.getSize(new THREE.Vector3()).length());
      this.orbit.around(box, this.robot.positions.filter(Boolean));
      this.layFloor(box);
    }
    this.redraw();
  }

  layFloor(box) {
    if (this.floor) {
      this.scene.remove(this.floor);
      this.floor.geometry.dispose();
    }
    const {grid, square} = floorGrid(box);
    this.floor = grid;
    this.floor.visible = this.gridShown;
    this.scene.add(grid);
    this.square = square;
    this.explain();
    this.colour();
  }

  // Updates the legend for what the map contains.
  explain() {
    this.warm = store.candidates.length > 0;
    const warm = this.warm ? [['lost', 'may be a victim'], ['third', 'warm, not a victim']] : [];
    legend([['estimate', 'camera path'], ['chosen', 'camera now'], ['truth', 'landmarks', 'dot'], ...warm, ['floor', `squares of ${squareSize(this.square)}`]]);
  }

  colour() {
    const ink = inks(theme.dark);
    this.scene.background = new THREE.Color(ink.paper);
    this.floor?.material.color.set(ink.floor);
    this.robot.colour();
    this.redraw();
  }

  look() {
    if (this.robot.pose) this.orbit.flyTo(this.robot.pose, (store.about.rig.near_m + store.about.rig.far_m) / 2);
  }
}

function controlsOf(stage) {
  const shown = (label, change) => checkbox(label, true, (checked) => {
    change(checked);
    stage.redraw();
  });
  const follow = checkbox('follow the robot', false, (checked) => (stage.following = checked));
  stage.canvas.addEventListener('keydown', (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.key === 'v' || event.key === 'V') stage.look();
    if (event.key === 'f' || event.key === 'F') follow.querySelector('input').click();
  });
  return [
    choice('colour', [['texture', 'texture'], ['height', 'height'], ['sigma', 'depth sigma']], (name) => stage.clouds.colourBy(name)),
    follow,
    shown('path', (on) => (stage.robot.path.material.visible = on)),
    shown('landmarks', (on) => (stage.robot.landmarks.visible = on)),
    shown('grid', (on) => {
      stage.gridShown = on;
      if (stage.floor) stage.floor.visible = on;
    }),
    element('button', {type: 'button', class: 'button', id: 'look', onclick: () => stage.look()}, 'Camera view'),
    element('button', {type: 'button', class: 'button', id: 'reset', onclick: () => stage.orbit.reset()}, 'Reset'),
  ];
}

export function showScene() {
  const canvas = byId('scene');
  const renderer = rendererOn(canvas);
  if (!renderer) return notice('This browser has no WebGL 2: the map cannot be displayed.');
  const stage = new Stage(canvas, renderer);
  byId('scene-controls').append(...controlsOf(stage));
  fitted(renderer, canvas, stage.orbit);
  theme.on(() => stage.colour());
  on('restart', () => stage.restart());
  on('change', () => stage.update());
}
