// SPDX-License-Identifier: Apache-2.0
// Measures pages of long runs in headless Chromium, without a GPU, and prints the result as JSON.
// node page_speed.mjs report FILE: seconds from opening a run's report until its map is drawn
// node page_speed.mjs live PROGRAM DATASET: frames per second while the map is turned on the live page, after a run with every
//   view as a keyframe; and the number of points on the page
import {mkdtempSync, rmSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {launch, open} from './browser.mjs';
import {serveProgram} from './served.mjs';

const [, , kind, ...words] = process.argv;
const kTurn_ms = 6000, kSettled_ms = 3000;
const pause = (ms) => new Promise((done) => setTimeout(done, ms));

async function reportTime(browser, file) {
  const start = Date.now();
  const {page, close} = await open(browser, file);
  await page.waitForSelector('canvas[data-drawn]');
  const open_s = (Date.now() - start) / 1e3;
  await close();
  return {open_s};
}

// Points of the map on the live page, once no more arrive.
async function allPoints(page) {
  const points = () => page.evaluate(() => Number(document.querySelector('canvas[data-points]')?.dataset.points ?? 0));
  await page.waitForFunction(() => document.querySelector('#connection').textContent === 'Finished', null, {timeout: 600e3});
  for (let before = -1, now = 0; ; before = now) {
    now = await points();
    if (now > 0 && now === before) return now;
    await pause(kSettled_ms);
  }
}

// Drags across the map and counts how often it is drawn.
async function framesPerSecond(page) {
  const canvas = page.locator('canvas[data-points]');
  const box = await canvas.boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await canvas.evaluate((element) => {
    window.drawn = 0;
    new MutationObserver(() => ++window.drawn).observe(element, {attributes: true, attributeFilter: ['data-drawn']});
  });
  await page.mouse.move(x, y);
  await page.mouse.down();
  const start = Date.now();
  for (let step = 0; Date.now() - start < kTurn_ms; ++step) await page.mouse.move(x + 150 * Math.sin(step / 20), y);
  const seconds = (Date.now() - start) / 1e3;
  await page.mouse.up();
  return await page.evaluate(() => window.drawn) / seconds;
}

async function liveSpeed(browser, program, dataset) {
  const folder = mkdtempSync(join(tmpdir(), 'fringeslam-live-speed-'));
  const served = await serveProgram(program, ['run', dataset, '--out', join(folder, 'run'), '--no-report', '--live', '0',
    '--live-wait', '--set', 'mapping.every_view=true'], 'live');
  try {
    const {page, close} = await open(browser, served.url);
    const points = await allPoints(page);
    const frames_per_s = await framesPerSecond(page);
    await close();
    return {points, frames_per_s};
  } finally {
    await served.stop('SIGTERM');
    rmSync(folder, {recursive: true, force: true});
  }
}

const browser = await launch();
try {
  console.log(JSON.stringify(await (kind === 'report' ? reportTime : liveSpeed)(browser, ...words)));
} finally {
  await browser.close();
}
