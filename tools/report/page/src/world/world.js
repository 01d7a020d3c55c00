// SPDX-License-Identifier: Apache-2.0
// The world in 3D: one instanced mesh per mesh of the scene, the path and the frusta of camera and projector.
import * as THREE from 'three';
import {inks} from '../shared/colours.js';
import {byId} from '../shared/dom.js';
import {frustum} from '../shared/frustum.js';
import {chain, segments, setSegments} from '../shared/lines.js';
import {Orbit} from '../shared/orbit.js';
import {fitted, legend, rendererOn} from '../shared/stage.js';
import {theme} from '../shared/theme.js';

const kClickPx = 5;  // longest movement of the pointer that is still a click

const poseOf = (numbers) => ({position: numbers.slice(0, 3), quaternion: numbers.slice(3)});
const matrixOf = ({pose}) => new THREE.Matrix4().compose(
  new THREE.Vector3(...pose.slice(0, 3)), new THREE.Quaternion(...pose.slice(3)), new THREE.Vector3(1, 1, 1));

// Format: number of vertices and triangles, positions, indices; 32 bits each.
function geometryOf(bytes) {
  const [vertices, triangles] = new Uint32Array(bytes, 0, 2);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(bytes, 8, 3 * vertices), 3));
  geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes, 8 + 12 * vertices, 3 * triangles), 1));
  return geometry;
}

export class World {
  constructor(scene) {
    this.data = scene;
    this.onSelect = () => {};
    this.canvas = byId('scene');
    this.renderer = rendererOn(this.canvas);
    if (!this.renderer) throw new Error('this browser has no WebGL 2');
    this.scene = new THREE.Scene();
    this.meshes = [];
    this.path = segments(chain(scene.path.map(({camera}) => new THREE.Vector3(...camera.slice(0, 3)))), 3);
    this.camera = segments([], 2.5);
    this.projector = segments([], 2.5);
    const sky = new THREE.HemisphereLight(0xffffff, 0x606060, 2.2);
    sky.position.set(0, 0, 1);
    this.scene.add(sky, this.path, this.camera, this.projector);
    // Framed: what the rig works on, not a room around it.
    const reach = new THREE.Box3();
    for (const {camera} of scene.path) {
      const place = new THREE.Vector3(...camera.slice(0, 3));
      const ahead = new THREE.Vector3(0, 0, scene.rig.far_m).applyQuaternion(new THREE.Quaternion(...camera.slice(3)));
      reach.expandByPoint(place).expandByPoint(place.clone().add(ahead));
    }
    this.orbit = new Orbit(this.canvas, reach, scene.path.map(({camera}) => new THREE.Vector3(...camera.slice(0, 3))), () => this.redraw());
    fitted(this.renderer, this.canvas, this.orbit);
    legend([['estimate', 'camera'], ['truth', 'projector'], ['third', 'camera path']]);
    theme.on((dark) => this.colour(dark));
    byId('reset').addEventListener('click', () => this.orbit.reset());
    this.listenForClicks();
  }

  redraw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => {
      this.asked = false;
      const moves = this.orbit.update(now);
      this.renderer.render(this.scene, this.orbit.camera);
      this.canvas.toggleAttribute('data-whole', this.loaded === true);
      if (moves) this.redraw();
    });
  }

  // Fetches the meshes one after another and draws each as it arrives.
  async load(fetchMesh) {
    const users = new Map();
    this.data.objects.forEach(({mesh}, i) => {
      if (!users.has(mesh)) users.set(mesh, []);
      users.get(mesh).push(i);
    });
    const box = new THREE.Box3();
    for (const [number, objects] of users) {
      const geometry = geometryOf(await (await fetchMesh(number)).arrayBuffer());
      const material = new THREE.MeshLambertMaterial({flatShading: true, side: THREE.DoubleSide});
      const mesh = new THREE.InstancedMesh(geometry, material, objects.length);
      objects.forEach((index, k) => {
        mesh.setMatrixAt(k, matrixOf(this.data.objects[index]));
        mesh.setColorAt(k, this.albedo(index));
      });
      mesh.userData.objects = objects;
      mesh.computeBoundingBox();
      box.union(mesh.boundingBox);
      this.meshes.push(mesh);
      this.scene.add(mesh);
      byId('scene-notice').hidden = true;
      this.redraw();
    }
    const size = box.getSize(new THREE.Vector3()).length();
    this.orbit.camera.far = Math.max(this.orbit.camera.far, 4 * size);
    this.orbit.camera.updateProjectionMatrix();
    this.loaded = true;
    this.redraw();
  }

  // Albedos are linear, as three.js expects.
  albedo(index) {
    return new THREE.Color().setScalar(this.data.objects[index].albedo);
  }

  colour(dark) {
    const ink = inks(dark);
    this.scene.background = new THREE.Color(ink.paper);
    this.camera.material.color.set(ink.estimate);
    this.projector.material.color.set(ink.truth);
    this.path.material.color.set(ink.third);
    this.redraw();
  }

  showRig({camera, projector}) {
    const {rig} = this.data;
    setSegments(this.camera, frustum(poseOf(camera), rig.far_m, rig.camera_corners));
    setSegments(this.projector, frustum(poseOf(projector), rig.far_m, rig.projector_corners));
    this.redraw();
  }

  select(index) {
    for (const mesh of this.meshes) {
      mesh.userData.objects.forEach((object, k) => mesh.setColorAt(k, object === index ? new THREE.Color(inks(theme.dark).chosen) : this.albedo(object)));
      mesh.instanceColor.needsUpdate = true;
    }
    this.canvas.dataset.selected = index;
    this.onSelect(index);
    this.redraw();
  }

  listenForClicks() {
    let start = null;
    this.canvas.addEventListener('pointerdown', (event) => (start = [event.clientX, event.clientY]));
    this.canvas.addEventListener('pointerup', (event) => {
      if (!start || Math.hypot(event.clientX - start[0], event.clientY - start[1]) > kClickPx) return;
      const {left, top, width, height} = this.canvas.getBoundingClientRect();
      const at = new THREE.Vector2(((event.clientX - left) / width) * 2 - 1, 1 - ((event.clientY - top) / height) * 2);
      const ray = new THREE.Raycaster();
      ray.setFromCamera(at, this.orbit.camera);
      const [hit] = ray.intersectObjects(this.meshes);
      if (hit) this.select(hit.object.userData.objects[hit.instanceId]);
    });
  }
}
