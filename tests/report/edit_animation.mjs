// SPDX-License-Identifier: Apache-2.0
// node edit_animation.mjs PROGRAM SCENE_FOLDER OUT.gif: animates the page of a scene while its file is edited: numbers are changed,
// a key is misspelled, and the mistake is corrected. The folder must contain boxes_and_foam/scene.yaml and rigs/, as scenes/ does.
import {cpSync, mkdtempSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import gifenc from 'gifenc';
import {decoded, launch, open} from './browser.mjs';
import {serveProgram} from './served.mjs';

const [, , program, scenes, out] = process.argv;
const kSize = {width: 1200, height: 720}, kFrameMs = 1400;
const {GIFEncoder, quantize, applyPalette} = gifenc;

const folder = mkdtempSync(join(tmpdir(), 'fringeslam-edit-'));
cpSync(join(scenes, 'boxes_and_foam'), join(folder, 'mine'), {recursive: true});
cpSync(join(scenes, 'rigs'), join(folder, 'rigs'), {recursive: true});
const file = join(folder, 'mine', 'scene.yaml');
const original = readFileSync(file, 'utf8');
const served = await serveProgram(program, ['scene', 'open', 'mine', '--port', '0'], 'scene', {cwd: folder});
const browser = await launch();
try {
  const {page, close} = await open(browser, served.url, {viewport: kSize});
  const gif = GIFEncoder();
  // Adds what the page shows, with the line of the file that was edited below the heading.
  const add = async (line, ms = kFrameMs) => {
    await page.evaluate((text) => {
      const note = document.querySelector('#edit-note') ?? document.querySelector('header').appendChild(Object.assign(document.createElement('code'), {id: 'edit-note'}));
      note.style.cssText = 'font-size: 1.1rem; padding: 0.3rem 0.8rem; border: 2px solid currentColor; border-radius: 6px;';
      note.textContent = text;
    }, `scene.yaml: ${line}`);
    await page.waitForFunction(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true)))));
    const pixels = await decoded(page, await page.screenshot());
    const palette = quantize(pixels, 256);
    gif.writeFrame(applyPalette(pixels, palette), kSize.width, kSize.height, {palette, delay: ms});
  };
  const drawn = async (before) => {
    await page.waitForFunction((last) => document.querySelector('#scene').dataset.whole > last, before);
    await page.waitForSelector('#sensor-picture[data-shown$="full"]');
    await page.waitForFunction(() => document.querySelector('#sensor-picture').dataset.scene === document.querySelector('#scene').dataset.whole);
  };
  // The path has the colors of its difficulty.
  const assessed = () => page.waitForFunction(() => /^[^-]+$/.test(document.querySelector('#scene').dataset.levels));
  const edit = async (text, line) => {
    const before = await page.locator('#scene').getAttribute('data-whole');
    writeFileSync(file, text);
    await drawn(before);
    await assessed();
    await add(line);
  };
  await page.waitForSelector('#scene[data-whole]', {state: 'attached'});
  await page.waitForSelector('#sensor-picture[data-shown$="full"]');
  await assessed();
  await add('area_m: [0.34, 0.34]');
  const wider = original.replace('area_m: [0.34, 0.34]', 'area_m: [0.6, 0.6]');
  await edit(wider, 'area_m: [0.6, 0.6]');
  const more = wider.replace('count: 26', 'count: 80');
  await edit(more, 'count: 80');
  writeFileSync(file, more.replace('max_height_m: 0.16', 'max_hight_m: 0.3'));
  await page.locator('#scene-error').waitFor();
  await add('max_hight_m: 0.3', 2 * kFrameMs);
  await edit(more.replace('max_height_m: 0.16', 'max_height_m: 0.3'), 'max_height_m: 0.3');
  gif.finish();
  writeFileSync(out, gif.bytes());
  await close();
} finally {
  await served.stop('SIGTERM');
  await browser.close();
  rmSync(folder, {recursive: true, force: true});
}
