// SPDX-License-Identifier: Apache-2.0
// The world in 3D: one instanced mesh per mesh of the scene, the path and the frusta of camera and projector.
import * as THREE from 'three';
import {inks} from '../shared/colours.js';
import {byId} from '../shared/dom.js';
import {frustum} from '../shared/frustum.js';
import {chain, segments, setSegments} from '../shared/lines.js';
import {TransformControls} from 'three/addons/controls/TransformControls.js';
import {Orbit} from '../shared/orbit.js';
import {drawsInSoftware, fitted, legend, rendererOn} from '../shared/stage.js';
import {theme} from '../shared/theme.js';
import {kLevels} from './difficulty.js';
import {placeOf, waypointsOf} from './places.js';

const kReachPx = 10;  // of a click, around a waypoint
const kClickPx = 5;  // longest movement of the pointer that is still a click
const kFetches = 4;  // at a time; browsers allow six, and the sensor view needs some
const kLoadingFrameMs = 500;  // between frames while a scene loads: without a GPU, one takes longer than fetching ten meshes

const poseOf = (numbers) => ({position: numbers.slice(0, 3), quaternion: numbers.slice(3)});
const matrixOf = ({pose}) => new THREE.Matrix4().compose(
  new THREE.Vector3(...pose.slice(0, 3)), new THREE.Quaternion(...pose.slice(3)), new THREE.Vector3(1, 1, 1));

// Format: number of vertices and triangles, whether there are texture coordinates, positions, indices, texture
// coordinates; 32 bits each.
function geometryOf(bytes) {
  const [vertices, triangles, coordinates] = new Uint32Array(bytes, 0, 3);
  const indices = 12 + 12 * vertices;
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(bytes, 12, 3 * vertices), 3));
  geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes, indices, 3 * triangles), 1));
  if (coordinates) geometry.setAttribute('uv', new THREE.BufferAttribute(new Float32Array(bytes, indices + 12 * triangles, 2 * vertices), 2));
  return geometry;
}

// Albedos are linear, as three.js expects.
const albedoOf = ({albedo}) => new THREE.Color().setScalar(albedo);

const kWraps = {repeat: THREE.RepeatWrapping, mirror: THREE.MirroredRepeatWrapping, clamp: THREE.ClampToEdgeWrapping};

// Returns the texture of a PNG, whose values are linear.
async function textureOf(answer, {edge}) {
  const image = await createImageBitmap(await answer.blob(), {colorSpaceConversion: 'none', imageOrientation: 'flipY'});
  const texture = new THREE.Texture(image);
  const wrap = kWraps[edge];
  Object.assign(texture, {wrapS: wrap, wrapT: wrap, flipY: false, colorSpace: THREE.NoColorSpace, anisotropy: drawsInSoftware ? 1 : 4, needsUpdate: true});
  return texture;
}

// Multiplies the color of a material by a tile: at the texture coordinates, or projected along the axis of the object's frame
// closest to the normal.
function cover(material, texture, {size_m: size, scale, centered}, byCoordinates) {
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, {
      tile: {value: texture}, tileSize: {value: size}, tileScale: {value: scale}, tileStart: {value: centered ? 0.5 : 0},
    });
    shader.vertexShader = shader.vertexShader.replace('void main() {', `
      varying vec3 inObject;
      varying vec2 onTile;
      void main() {
        inObject = position;
        onTile = ${byCoordinates ? 'uv' : 'vec2(0.0)'};`);
    shader.fragmentShader = shader.fragmentShader.replace('void main() {', `
      uniform sampler2D tile;
      uniform float tileSize, tileScale, tileStart;
      varying vec3 inObject;
      varying vec2 onTile;
      void main() {`).replace('#include <color_fragment>', `
      #include <color_fragment>
      vec3 facing = abs(cross(dFdx(inObject), dFdy(inObject)));
      vec2 projected = facing.x >= facing.y && facing.x >= facing.z ? inObject.yz : facing.y >= facing.z ? inObject.zx : inObject.xy;
      vec2 at = ${byCoordinates ? 'onTile' : 'projected / tileSize + tileStart'};
      diffuseColor.rgb *= tileScale * texture2D(tile, at).r;`);
  };
  material.customProgramCacheKey = () => `tile ${byCoordinates}`;
}

// Returns a mesh of the scene's objects with these indices; `tile`: {texture, about} or null.
function instanced(geometry, scene, objects, tile) {
  const material = new THREE.MeshLambertMaterial({flatShading: true, side: THREE.DoubleSide});
  const repeats = tile?.about.edge === 'repeat';
  if (tile) cover(material, tile.texture, tile.about, repeats && geometry.hasAttribute('uv'));
  const mesh = new THREE.InstancedMesh(geometry, material, objects.length);
  objects.forEach((index, k) => {
    mesh.setMatrixAt(k, matrixOf(scene.objects[index]));
    mesh.setColorAt(k, albedoOf(scene.objects[index]));
  });
  mesh.userData.objects = objects;
  mesh.computeBoundingBox();
  return mesh;
}

export class World {
  constructor() {
    this.data = null;
    this.selected = undefined;
    this.waypoint = undefined;  // path of the selected one
    this.onSelect = () => {};
    this.onPlace = () => {};  // called with a path and a position
    this.canvas = byId('scene');
    this.renderer = rendererOn(this.canvas);
    if (!this.renderer) throw new Error('this browser has no WebGL 2');
    this.scene = new THREE.Scene();
    this.meshes = [];
    this.geometries = new Map();  // by name, of the meshes shown
    this.textures = new Map();  // by name and edge, of their tiles
    this.path = segments([], 4, {vertexColors: true});
    this.stops = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial({size: 9, sizeAttenuation: false, vertexColors: true}));
    this.places = [];  // of the path
    this.waypoints = [];
    this.marks = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial({size: 7, sizeAttenuation: false}));
    this.levels = [];  // of difficulty, by place
    this.camera = segments([], 2.5);
    this.projector = segments([], 2.5);
    const sky = new THREE.HemisphereLight(0xffffff, 0x606060, 2.2);
    sky.position.set(0, 0, 1);
    this.scene.add(sky, this.path, this.stops, this.marks, this.camera, this.projector);
    this.orbit = new Orbit(this.canvas, new THREE.Box3(new THREE.Vector3(), new THREE.Vector3(1, 1, 1)), [], () => this.redraw());
    this.addGizmo();
    fitted(this.renderer, this.canvas, this.orbit);
    legend([['estimate', 'camera'], ['truth', 'projector']]);
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
      if (this.data) this.canvas.dataset.whole = this.data.number;
      this.noteGrip();
      if (moves) this.redraw();
    });
  }

  // Fetches a scene's meshes, except those already shown, and shows it. The first scene's meshes appear one after
  // another; a later scene replaces what differs from its predecessor at once. Returns false if a mesh is gone, because
  // there is a newer scene.
  async show(scene, fetchMesh, fetchTile) {
    const users = new Map();  // indices of the objects with the same mesh and tile
    scene.objects.forEach(({mesh, tile}, i) => {
      const key = `${mesh} ${tile}`;
      if (!users.has(key)) users.set(key, {name: mesh, about: scene.tiles[tile] ?? null, objects: []});
      users.get(key).objects.push(i);
    });
    const first = this.data === null;
    if (first) this.frame(scene);
    const geometries = new Map(), textures = new Map(), meshes = [];
    // Takes what is shown already, or else fetches it; the result is undefined if it is gone.
    const wanted = (key, now, before, fetched, made) => {
      if (!now.has(key)) now.set(key, before.get(key) ?? fetched().then((answer) => answer && made(answer)));
      return now.get(key);
    };
    let drawn_ms = -Infinity, gone = false;
    const kept = new Map(this.meshes.map((mesh) => [mesh.userData.content, mesh]));
    const add = async ({name, about, objects}) => {
      const [geometry, texture] = await Promise.all([
        wanted(name, geometries, this.geometries, () => fetchMesh(name), async (answer) => geometryOf(await answer.arrayBuffer())),
        about && wanted(`${about.picture} ${about.edge}`, textures, this.textures,
          () => fetchTile(about.picture), (answer) => textureOf(answer, about)),
      ]);
      gone ||= !geometry || texture === undefined;
      if (gone) return;
      const content = JSON.stringify([name, about, objects.map((i) => [i, scene.objects[i].pose, scene.objects[i].albedo])]);
      const mesh = kept.get(content) ?? instanced(geometry, scene, objects, about && {texture, about});
      mesh.userData.content = content;
      meshes.push(mesh);
      if (!first) return;
      this.scene.add(mesh);
      byId('scene-notice').hidden = true;
      if (performance.now() < drawn_ms + kLoadingFrameMs) return;
      drawn_ms = performance.now();
      this.redraw();
    };
    const pending = [...users.values()];
    const others = (list, than) => list.filter((mesh) => !than.includes(mesh));
    let failure;
    await Promise.all(Array.from({length: kFetches}, async () => {
      try {
        while (pending.length > 0 && !gone) await add(pending.shift());
      } catch (error) {
        failure ??= error;
        gone = true;
      }
    }));
    if (gone) {
      this.remove(others(meshes, this.meshes));
      if (failure) throw failure;
      return false;
    }
    this.remove(others(this.meshes, meshes));
    for (const [name, geometry] of this.geometries) if (!geometries.has(name)) geometry.dispose();
    for (const [name, texture] of this.textures) if (!textures.has(name)) texture.dispose();
    const loaded = async (map) => new Map(await Promise.all([...map].map(async ([key, value]) => [key, await value])));
    Object.assign(this, {data: scene, meshes, geometries: await loaded(geometries), textures: await loaded(textures)});
    if (this.selected >= scene.objects.length) this.selected = undefined;
    if (!first) this.frame(scene);
    this.scene.add(...meshes);
    const box = new THREE.Box3();
    for (const mesh of meshes) box.union(mesh.boundingBox);
    const size = box.getSize(new THREE.Vector3()).length();
    this.orbit.camera.far = Math.max(this.orbit.camera.far, 4 * size);
    this.orbit.camera.updateProjectionMatrix();
    this.markSelected();
    return true;
  }

  // Directs the view to what the rig works on, not a room around it, unless the user has chosen a view.
  frame(scene) {
    const {path, rig, continuous} = scene;
    Object.assign(this, {rig, places: path});
    const places = path.map(({camera}) => new THREE.Vector3(...camera.slice(0, 3)));
    setSegments(this.path, chain(places));
    // The views of a robot that stops for each; a single one has no path.
    this.stops.geometry.dispose();
    this.stops.geometry = new THREE.BufferGeometry().setFromPoints(continuous ? [] : places);
    this.stops.visible = !continuous;
    this.levels = [];
    this.waypoints = waypointsOf(scene);
    this.marks.geometry.dispose();
    this.marks.geometry = new THREE.BufferGeometry().setFromPoints(this.waypoints.map(({position}) => new THREE.Vector3(...position)));
    this.drawLevels();
    const reach = new THREE.Box3();
    path.forEach(({camera}, i) => {
      const ahead = new THREE.Vector3(0, 0, rig.far_m).applyQuaternion(new THREE.Quaternion(...camera.slice(3)));
      reach.expandByPoint(places[i]).expandByPoint(places[i].clone().add(ahead));
    });
    this.orbit.around(reach, places);
  }

  remove(meshes) {
    this.scene.remove(...meshes);
    for (const mesh of meshes) {
      mesh.material.dispose();
      mesh.dispose();
    }
  }

  colour(dark) {
    const ink = inks(dark);
    this.scene.background = new THREE.Color(ink.paper);
    this.camera.material.color.set(ink.estimate);
    this.projector.material.color.set(ink.truth);
    this.marks.material.color.set(ink.chosen);
    this.drawLevels();
  }

  // Colours the path by the level of difficulty of the nearest of `views`, and leaves the rest grey.
  colourPath(levels, views) {
    const reach_s = views.length > 1 ? views[1].time_s - views[0].time_s : 0;
    let k = 0;
    this.levels = this.places.map(({time_s}) => {
      while (k + 1 < views.length && Math.abs(views[k + 1].time_s - time_s) <= Math.abs(views[k].time_s - time_s)) ++k;
      return views.length > 0 && time_s <= views[k].time_s + reach_s ? levels[k] : undefined;
    });
    this.drawLevels();
  }

  drawLevels() {
    const style = getComputedStyle(document.documentElement);
    const inkOf = (level) => new THREE.Color(style.getPropertyValue(level === undefined ? '--soft' : `--${kLevels[level]}`).trim());
    const colours = this.places.map((_, i) => inkOf(this.levels[i]));
    const numbers = (list) => new Float32Array(list.flatMap((colour) => colour.toArray()));
    if (colours.length > 1) this.path.geometry.setColors(numbers(chain(colours)));
    if (this.stops.visible) this.stops.geometry.setAttribute('color', new THREE.BufferAttribute(numbers(colours), 3));
    this.canvas.dataset.levels = this.levels.map((level) => level ?? '-').join('');
    this.redraw();
  }

  showRig({camera, projector}) {
    const {rig} = this;
    setSegments(this.camera, frustum(poseOf(camera), rig.far_m, rig.camera_corners));
    setSegments(this.projector, frustum(poseOf(projector), rig.far_m, rig.projector_corners));
    this.redraw();
  }

  // Arrows by which the selected object or waypoint is dragged.
  addGizmo() {
    this.held = new THREE.Object3D();
    this.gizmo = new TransformControls(this.orbit.camera, this.canvas);
    this.gizmo.setSize(0.7);
    this.scene.add(this.held, this.gizmo.getHelper());
    this.gizmo.addEventListener('change', () => this.redraw());
    this.gizmo.addEventListener('dragging-changed', ({value}) => (this.orbit.controls.enabled = !value));
    this.gizmo.addEventListener('objectChange', () => this.preview());
    this.gizmo.addEventListener('mouseUp', () => {
      const place = this.place();
      if (place && !this.held.position.equals(new THREE.Vector3(...place.position))) this.onPlace(place, this.held.position.toArray());
    });
  }

  // Notes where the arrow along x is drawn, as shares of width and height.
  noteGrip() {
    if (!this.gizmo.object) return delete this.canvas.dataset.grip;
    const {camera} = this.orbit, {position} = this.held;
    const size = position.distanceTo(camera.position) * Math.min(1.9 * Math.tan(Math.PI * camera.fov / 360) / camera.zoom, 7) * this.gizmo.size / 4;
    const {x, y} = position.clone().add(new THREE.Vector3(0.4 * size, 0, 0)).project(camera);
    return (this.canvas.dataset.grip = `${((x + 1) / 2).toFixed(4)},${((1 - y) / 2).toFixed(4)}`);
  }

  // Returns the place of the selected object or waypoint, if it can be dragged.
  place() {
    return this.waypoint ? this.waypoints.find(({path}) => path === this.waypoint) : this.data && placeOf(this.data, this.selected);
  }

  // Shows the object where it is dragged to.
  preview() {
    if (this.waypoint) return;
    for (const mesh of this.meshes) {
      const k = mesh.userData.objects.indexOf(this.selected);
      if (k < 0) continue;
      mesh.setMatrixAt(k, matrixOf(this.data.objects[this.selected]).setPosition(this.held.position));
      mesh.instanceMatrix.needsUpdate = true;
      mesh.userData.content = null;  // no longer what the scene says
    }
  }

  select(index) {
    this.selected = index;
    this.waypoint = undefined;
    this.markSelected();
    this.onSelect(this.place());
  }

  selectWaypoint(path) {
    this.selected = undefined;
    this.waypoint = path;
    this.markSelected();
    this.onSelect(this.place());
  }

  markSelected() {
    const chosen = new THREE.Color(inks(theme.dark).chosen);
    for (const mesh of this.meshes) {
      mesh.userData.objects.forEach((object, k) => mesh.setColorAt(k, object === this.selected ? chosen : albedoOf(this.data.objects[object])));
      mesh.instanceColor.needsUpdate = true;
    }
    const place = this.place();
    if (this.waypoint && !place) this.waypoint = undefined;
    if (!this.gizmo.dragging) {
      if (place) this.gizmo.attach(this.held);
      else this.gizmo.detach();
      if (place) this.held.position.set(...place.position);
      if (place) this.preview();
    }
    if (this.selected === undefined) delete this.canvas.dataset.selected;
    else this.canvas.dataset.selected = this.selected;
    this.redraw();
  }

  listenForClicks() {
    let start = null;
    this.canvas.addEventListener('pointerdown', (event) => (start = [event.clientX, event.clientY]));
    this.canvas.addEventListener('pointerup', (event) => {
      if (!start || this.gizmo.axis || Math.hypot(event.clientX - start[0], event.clientY - start[1]) > kClickPx) return;
      const {left, top, width, height} = this.canvas.getBoundingClientRect();
      const at = new THREE.Vector2(((event.clientX - left) / width) * 2 - 1, 1 - ((event.clientY - top) / height) * 2);
      const near = this.waypoints.map(({path, position}) => {
        const {x, y, z} = new THREE.Vector3(...position).project(this.orbit.camera);
        return {path, away: z < 1 ? Math.hypot((x - at.x) * width / 2, (y - at.y) * height / 2) : Infinity};
      }).filter(({away}) => away <= kReachPx).sort((a, b) => a.away - b.away);
      if (near.length) return this.selectWaypoint(near[0].path);
      const ray = new THREE.Raycaster();
      ray.setFromCamera(at, this.orbit.camera);
      const [hit] = ray.intersectObjects(this.meshes);
      if (hit) this.select(hit.object.userData.objects[hit.instanceId]);
    });
  }
}
