// SPDX-License-Identifier: Apache-2.0
// report.html in a browser. FRINGESLAM_PROGRAM and FRINGESLAM_SOURCE_DIR select what is tested; files go to the current
// folder.
import assert from 'node:assert/strict';
import {statSync} from 'node:fs';
import {resolve} from 'node:path';
import {after, before, test} from 'node:test';
import {changed, darkness, kTimeoutMs, launch, look, open as openIn, overflow, reachedByTab} from './browser.mjs';
import {Runs, kWildName} from './runs.mjs';

const runs = new Runs(process.env.FRINGESLAM_PROGRAM, process.env.FRINGESLAM_SOURCE_DIR, resolve('runs'));
let browser, full;
const open = (file, options) => openIn(browser, file, options);

before(async () => {
  full = runs.make('full');
  browser = await launch();
}, {timeout: 3 * kTimeoutMs});
after(() => browser?.close());

async function drawn(page) {
  await page.waitForSelector('canvas[data-drawn]');
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
}

const label = (page) => page.locator('#label').textContent();

test('the head shows name and figures, the map is drawn, its colours can be chosen', async () => {
  const {page, close} = await open(full);
  await drawn(page);
  // Unescaped, the scene's name would end the script element and insert another one.
  assert.equal(await page.locator('#name').textContent(), kWildName);
  assert.equal(await page.title(), `${kWildName} · FringeSLAM`);
  assert.equal(await page.locator('#hurt').count(), 0);
  const score = runs.read('full', 'score.json');
  const head = await page.locator('#figures').innerText();
  assert.match(head, /3 of 4/);
  assert.match(head, /1 lost/);
  const ate = head.match(/ATE\s+([\d.]+)/);
  assert.ok(Math.abs(ate[1] - score.trajectory.ate_rmse_mm) < 0.01 * score.trajectory.ate_rmse_mm + 1e-6, head);
  let seen = await look(page, '.stage');
  assert.ok(seen.colours > 500, `only ${seen.colours} colours`);
  for (const colouring of ['height', 'error', 'texture']) {
    await page.getByLabel('colour', {exact: true}).selectOption(colouring);
    seen = await changed(page, '.stage', seen);
  }
  await page.getByLabel('show as', {exact: true}).selectOption('points');
  seen = await changed(page, '.stage', seen);
  for (const name of ['frusta', 'estimated path', 'grid']) {
    await page.getByLabel(name, {exact: true}).uncheck();
    seen = await changed(page, '.stage', seen);
  }
  await close();
});

test('scrubbing changes pictures, label and map; the keys do as well', async () => {
  const {page, close} = await open(full);
  await drawn(page);
  assert.match(await label(page), /View 0 \(1 of 4\).*first view/);
  const cards = ['Texture', 'Depth', 'Depth error'].map((name) => `figure.card:has(h3:text-is("${name}")) .frame`);
  let seen = await Promise.all(cards.map((card) => look(page, card)));
  for (const view of seen) assert.ok(view.colours > 50, `only ${view.colours} colours`);
  let map = await look(page, '.stage');
  const next = async (act, says) => {
    await act();
    assert.match(await label(page), says);
    for (const [i, card] of cards.entries()) seen[i] = await changed(page, card, seen[i]);
    map = await changed(page, '.stage', map);
  };
  await next(() => page.locator('#next').click(), /View 1 /);
  await next(() => page.locator('#slider').fill('2'), /View 2 .*lost/);
  assert.match(await page.locator('.badge').innerText(), /lost/);
  await page.locator('body').click({position: {x: 2, y: 2}});
  await next(() => page.keyboard.press('ArrowLeft'), /View 1 /);
  await page.keyboard.press('ArrowRight');
  await page.keyboard.press('ArrowRight');
  await page.keyboard.press('ArrowRight');
  assert.match(await label(page), /View 3 .*relocalized/);
  await page.locator('#motions .chooser').first().click();
  assert.match(await label(page), /View 1 /);
  assert.equal(await page.locator('tbody.chosen').count(), 1);
  await close();
});

test('the map is turned, shifted, zoomed and reset by mouse and keys', async () => {
  const {page, close} = await open(full);
  await drawn(page);
  const first = await look(page, '.stage');
  let seen = first;
  await page.locator('#scene').focus();
  for (const key of ['ArrowLeft', 'ArrowUp', 'Shift+ArrowRight', '+', '-', 'v']) {
    await page.keyboard.press(key);
    seen = await changed(page, '.stage', seen);
  }
  assert.match(await label(page), /View 0 /);
  await page.keyboard.press('r');
  await changed(page, '.stage', seen);
  const box = await page.locator('#scene').boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  seen = await look(page, '.stage');
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 80, y + 20, {steps: 3});
  await page.mouse.up();
  seen = await changed(page, '.stage', seen);
  await page.mouse.wheel(0, -300);
  await changed(page, '.stage', seen);
  await page.locator('#reset').click();
  await close();
});

test('all that can be operated is reached by Tab and shows its focus', async () => {
  const {page, close} = await open(full);
  await drawn(page);
  const reached = await reachedByTab(page, 40);
  for (const id of ['theme', 'scene', 'reset', 'slider', 'next', 'scroller']) assert.ok(reached.has(id), id);
  await close();
});

test('it follows the system to the dark, and the button back', async () => {
  const {page, close} = await open(full, {colorScheme: 'dark'});
  await drawn(page);
  assert.ok((await darkness(page)) < 150);
  const dark = await look(page, '.stage');
  await page.locator('#theme').click();
  assert.ok((await darkness(page)) > 600);
  await changed(page, '.stage', dark);
  await close();
});

test('it fits a phone', async () => {
  const {page, close} = await open(full, {viewport: {width: 360, height: 740}, hasTouch: true, isMobile: true, deviceScaleFactor: 2});
  await drawn(page);
  assert.ok((await overflow(page)) <= 0, 'the page is wider than the phone');
  await page.getByRole('button', {name: 'Next view'}).tap();
  assert.match(await label(page), /View 1 /);
  for (const id of ['#scene', '#slider', '#plots', '#label']) {
    const box = await page.locator(id).boundingBox();
    assert.ok(box.x >= 0 && box.x + box.width <= 360, `${id} sticks out`);
  }
  await close();
});

test('a run without truth, of one view, or with none that was tracked', async () => {
  const {page, close} = await open(runs.withoutTruth('full', 'untold'));
  await drawn(page);
  assert.match(await page.locator('#figures').innerText(), /no ground truth/);
  assert.equal(await page.locator('#motions tr.estimate').count(), 2);
  assert.equal(await page.locator('#motions tr.error').count(), 0);
  assert.equal(await page.getByText('Depth error').count(), 0);
  assert.doesNotMatch(await page.locator('main').innerText(), /NaN|undefined|null/);
  await close();

  const alone = await open(runs.oneView('alone'));
  await drawn(alone.page);
  assert.match(await label(alone.page), /1 of 1/);
  assert.equal(await alone.page.locator('#motions').isVisible(), false);
  assert.doesNotMatch(await alone.page.locator('main').innerText(), /NaN|undefined|null/);
  await alone.close();

  const lost = await open(runs.lost('full', 'lost'));
  assert.match(await lost.page.locator('#figures').innerText(), /0 of 4/);
  assert.match(await lost.page.locator('#scene-notice').innerText(), /no map/);
  assert.doesNotMatch(await lost.page.locator('main').innerText(), /NaN|undefined|null/);
  await lost.close();
});

test('a long run stays small and says what it leaves out', async () => {
  const file = runs.many('full', 'many', 130);
  assert.ok(statSync(file).size < 10e6, `${statSync(file).size} bytes`);
  const {page, close} = await open(file);
  await drawn(page);
  assert.match(await page.locator('#left-out').innerText(), /Every third of 130 views has pictures/);
  await page.locator('#slider').fill('100');
  assert.match(await page.locator('.borrowed').innerText(), /Pictures of view 99; those of view 100/);
  await close();
});
