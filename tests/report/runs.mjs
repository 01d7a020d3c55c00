// SPDX-License-Identifier: Apache-2.0
// Runs whose pages are tested: small ones made by the program, and variants of their files.
import {execFileSync} from 'node:child_process';
import {cpSync, mkdirSync, readFileSync, rmSync, symlinkSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';

export const kWildName = '</script><b id="hurt">"\' & <!--';

const kStep = '    - {translation_mm: [6, 4, 0], rotation_deg: [0, 0, 1]}\n';
const kAway = '    - {translation_mm: [900, 0, 0], rotation_deg: [0, 0, 0]}\n';
const kBack = '    - {translation_mm: [-900, 0, 0], rotation_deg: [0, 0, 0]}\n';

// A floor and some boxes. `motions`: lines of the scene file; may be empty.
export function sceneText(name, tested, {count, size, motions}) {
  return `name: ${name}
description: For the tests of ${tested}
seed: 3
rig: {file: rig.yaml}
patterns: {axis: columns, steps: 3, periods_px: [1040, 131, 16.5], bits: 8}
light: {ambient_lux: 290}
materials:
  table: {grain: wood, albedo: 0.4, contrast: 0.35, grain_m: 0.012}
  cardboard: {grain: cardboard, albedo: 0.55, contrast: 0.35, grain_m: 0.01}
objects:
  - {shape: plane, size_m: [0.8, 0.8], material: table}
  - shape: scatter
    count: ${count}
    area_m: [${size}, ${size}]
    max_height_m: 0.12
    items:
      - {shape: box, size_min_m: [0.04, 0.03, 0.02], size_max_m: [0.09, 0.08, 0.08], material: cardboard}
trajectory:
  interval_s: 0.5
${motions && `  motions:\n${motions}`}`;
}

// The second-to-last view sees nothing.
const kScene = sceneText(`'${kWildName.replaceAll("'", "''")}'`, 'report.html',
  {count: 12, size: 0.24, motions: kStep + kAway + kBack});

export class Runs {
  constructor(program, source, folder) {
    Object.assign(this, {program, source, folder});
    rmSync(folder, {recursive: true, force: true});
    mkdirSync(folder, {recursive: true});
  }

  at(...names) {
    return join(this.folder, ...names);
  }

  call(...words) {
    execFileSync(this.program, [...words, '--quiet'], {stdio: ['ignore', 'ignore', 'inherit']});
  }

  read(run, name) {
    return JSON.parse(readFileSync(this.at(run, name)));
  }

  write(run, name, json) {
    writeFileSync(this.at(run, name), JSON.stringify(json));
  }

  // Creates a scene's folder, with a rig of a quarter of the pixels of the supplied one.
  scene(name, scene = kScene) {
    const place = this.at(name);
    mkdirSync(place);
    const rig = readFileSync(join(this.source, 'scenes/rigs/thesis.yaml'), 'utf8')
      .replace('width_px: 532', 'width_px: 266').replace('height_px: 500', 'height_px: 250')
      .replace('fx_px: 2046', 'fx_px: 1023').replace('fy_px: 2046', 'fy_px: 1023')
      .replace('cx_px: 265.5', 'cx_px: 132.5').replace('cy_px: 249.5', 'cy_px: 124.5');
    writeFileSync(join(place, 'rig.yaml'), rig);
    writeFileSync(join(place, 'scene.yaml'), scene);
    return place;
  }

  make(run, scene = kScene) {
    const place = this.scene(`${run}-scene`, scene);
    this.call('run', place, '--out', this.at(run), '--set', 'render.samples_per_pixel=1');
    return this.page(run);
  }

  page(run) {
    return this.at(run, 'report.html');
  }

  // Regenerates the page of `run` after its files were changed.
  again(run) {
    this.call('report', this.at(run));
    return this.page(run);
  }

  withoutTruth(from, run) {
    cpSync(this.at(from), this.at(run), {recursive: true});
    for (const name of ['truth', 'truth.tum', 'score.json']) rmSync(this.at(run, name), {recursive: true});
    return this.again(run);
  }

  oneView(run) {
    return this.make(run, kScene.replace(/  motions:[^]*/, '').replace(/^name: .*/, 'name: alone'));
  }

  // A run in which nothing was tracked or mapped.
  lost(from, run) {
    cpSync(this.at(from), this.at(run), {recursive: true});
    for (const name of ['truth', 'truth.tum', 'score.json', 'map.ply', 'mesh.ply']) {
      rmSync(this.at(run, name), {recursive: true, force: true});
    }
    this.write(run, 'frames.json', this.read(run, 'frames.json').map((frame) => ({...frame, tracking: 'lost'})));
    writeFileSync(this.at(run, 'trajectory.tum'), '# lost: stacks 0, 1, 2, 3\n');
    return this.again(run);
  }

  // Repeats the first view of a run along a straight path.
  many(from, run, count) {
    const [first] = this.read(from, 'frames.json');
    mkdirSync(this.at(run, 'frames'), {recursive: true});
    for (const name of ['config.yaml', 'rig.yaml', 'mesh.ply']) cpSync(this.at(from, name), this.at(run, name));
    const frames = Array.from({length: count}, (_, index) => ({...first, index, tracking: index ? 'followed' : 'first'}));
    this.write(run, 'frames.json', frames);
    for (const {index} of frames) {
      symlinkSync(this.at(from, 'frames/000000'), this.at(run, 'frames', String(index).padStart(6, '0')));
    }
    writeFileSync(this.at(run, 'trajectory.tum'), frames.map(({index}) => `${index} ${index / 500} 0 0 0 0 0 1\n`).join(''));
    return this.again(run);
  }
}
