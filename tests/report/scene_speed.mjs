// SPDX-License-Identifier: Apache-2.0
// node scene_speed.mjs PROGRAM SCENES TURNS: measures the page of scene rubble_pile and prints the seconds of each turn as JSON.
//   open: from the command to the first picture of the sensor view beside the drawn world; settled rubble is cached
//   view: from moving the slider to the first picture of another view
//   light, material, path: from saving another number of this kind to the first picture of the new world
import {cpSync, mkdtempSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {launch, open} from './browser.mjs';
import {serveProgram} from './served.mjs';

const [, , program, scenes, turns] = process.argv;
const folder = mkdtempSync(join(tmpdir(), 'fringeslam-scene-speed-'));
for (const part of ['rubble_pile', 'common', 'rigs']) cpSync(join(scenes, part), join(folder, part), {recursive: true});
const file = join(folder, 'rubble_pile', 'scene.yaml');
const materials = join(folder, 'common', 'rubble_materials.yaml');
const serve = () => serveProgram(program, ['scene', 'open', 'rubble_pile', '--port', '0'], 'scene',
  {cwd: folder, env: {...process.env, FRINGESLAM_CACHE: join(folder, 'cache')}});

// Waits in the page until `reached` holds, which is called whenever an attribute changes, and returns the time.
const until = (page, reached, argument) => page.evaluate(([source, value]) => new Promise((done) => {
  const holds = new Function('value', `return (${source})(value)`);
  const observer = new MutationObserver(() => check());
  const check = () => {
    if (!holds(value)) return;
    observer.disconnect();
    done(Date.now());
  };
  observer.observe(document.documentElement, {attributes: true, subtree: true});
  check();
}), [reached.toString(), argument]);

const kPictured = () => document.querySelector('#scene').dataset.whole && document.querySelector('#sensor-picture').dataset.shown;
const kNewWorld = (before) => {
  const whole = document.querySelector('#scene').dataset.whole;
  return Number(whole) > Number(before) && document.querySelector('#sensor-picture').dataset.scene === whole;
};
const idle = (page) => page.waitForSelector('#sensor-picture[data-shown$="full"]');

const times = {open: [], view: [], light: [], material: [], path: []};
const browser = await launch();

async function changeTime(page, path, from, to) {
  const text = readFileSync(path, 'utf8');
  if (!text.includes(from)) throw new Error(`${path} has no '${from}'`);
  const before = await page.locator('#scene').getAttribute('data-whole');
  const shown = until(page, kNewWorld, before);
  const start = Date.now();
  writeFileSync(path, text.replace(from, to));
  return (await shown - start) / 1e3;
}

// The slider of a page with two views or more moves to the other one.
const viewTime = (page, turn) => page.evaluate((place) => new Promise((done) => {
  const picture = document.querySelector('#sensor-picture'), slider = document.querySelector('#time');
  const start = performance.now();
  const observer = new MutationObserver(() => {
    if (!picture.dataset.shown.includes(` ${place} `)) return;
    observer.disconnect();
    done((performance.now() - start) / 1e3);
  });
  observer.observe(picture, {attributes: true});
  slider.value = place;
  slider.dispatchEvent(new Event('input', {bubbles: true}));
}), `${1 + turn % 2}`);

try {
  for (let turn = -1; turn < Number(turns); ++turn) {
    const start = Date.now();
    const served = await serve();
    const {page, close} = await open(browser, served.url);
    const opened = await until(page, kPictured);
    const measured = {open: (opened - start) / 1e3};
    await idle(page);
    measured.view = await viewTime(page, turn + 2);
    await idle(page);
    const number = 100 + turn;
    measured.light = await changeTime(page, file, /ambient_lux: .*/.exec(readFileSync(file, 'utf8'))[0], `ambient_lux: ${number}`);
    await idle(page);
    const material = /albedo: (\{[^}]*\}|[0-9.]+)/.exec(readFileSync(materials, 'utf8'))[0];
    measured.material = await changeTime(page, materials, material, `albedo: 0.${number}`);
    await idle(page);
    const start_pose = /start: .*/.exec(readFileSync(file, 'utf8'))[0];
    measured.path = await changeTime(page, file, start_pose, `start: {translation_m: [0, 0, 0.0${number}]}`);
    await close();
    await served.stop('SIGTERM');
    if (turn < 0) continue;  // settles the rubble, for the cache
    for (const [kind, seconds] of Object.entries(measured)) times[kind].push(seconds);
  }
  console.log(JSON.stringify(times));
} finally {
  await browser.close();
  rmSync(folder, {recursive: true, force: true});
}
