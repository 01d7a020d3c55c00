// SPDX-License-Identifier: Apache-2.0
// The live page in a browser while `fringeslam run --live` maps small scenes. FRINGESLAM_PROGRAM and
// FRINGESLAM_SOURCE_DIR select what is tested; files go to the current folder.
import assert from 'node:assert/strict';
import {resolve} from 'node:path';
import {after, before, test} from 'node:test';
import {changed, darkness, kTimeoutMs, launch, look, open as openIn, overflow, reachedByTab, screenColours} from './browser.mjs';
import {Runs, sceneText} from './runs.mjs';
import {killServed, serveProgram} from './served.mjs';

const kToken = 'correct-horse-battery';
const kBack = [-900, 0];
// Steps of a third of the image, so that every one or two views yield a keyframe.
const kLong = [[80, 0], [80, 0], [0, 80], [-80, 0], [-80, 0], [0, -80]];
const kLost = [[6, 4], [900, 0], kBack, [6, 4]];

const runs = new Runs(process.env.FRINGESLAM_PROGRAM, process.env.FRINGESLAM_SOURCE_DIR, resolve('live'));
let browser, still, started = 0;

const motion = ([x, y]) => `    - {translation_mm: [${x}, ${y}, 0], rotation_deg: [0, 0, 0]}\n`;

const sceneOf = (name, motions, size = 0.5) =>
  sceneText(name, 'the live page', {count: 30, size, motions: motions.map(motion).join('')});

// Starts a run with a live page; it runs until it is stopped.
async function live(name, motions, ...words) {
  const folder = `${name}-${++started}`;
  return serveProgram(runs.program, ['run', runs.scene(folder, sceneOf(name, motions)), '--out', runs.at(`${folder}-run`),
    '--live-wait', '--no-report', '--set', 'render.samples_per_pixel=1', ...words], 'live');
}

const open = (url, options) => openIn(browser, url, options);
const drawn = (page) => page.waitForSelector('#scene[data-whole]', {state: 'attached'});
const says = (page, id, text) => page.waitForFunction(([name, expected]) => document.getElementById(name).textContent === expected, [id, text]);
const shown = (page, name) => page.locator('#scene-controls').getByLabel(name, {exact: true});
const landmarks = (page) => page.evaluate(() => Number(document.getElementById('scene').dataset.landmarks));
const points = (page) => page.evaluate(() => Number(document.getElementById('scene').dataset.points ?? 0));

// Number of pixels of the map that are not background (the most frequent colour).
async function filled(page) {
  const pixels = await screenColours(page, '#scene');
  const counts = new Map();
  for (const pixel of pixels) counts.set(pixel, (counts.get(pixel) ?? 0) + 1);
  return pixels.length - Math.max(...counts.values());
}

before(async () => {
  browser = await launch();
  still = await live('still', kLost, '--live', '0');
}, {timeout: 3 * kTimeoutMs});
after(async () => {
  killServed();
  await browser?.close();
});

// The program is paused while the page is inspected, so that nothing changes meanwhile on a slow machine.
test('the map fills while views come, and who comes late sees no less', async () => {
  const run = await live('long', kLong, '--live', '0', '--live-rate', '0.1');
  const {page, close} = await open(run.url);
  await drawn(page);
  run.signal('SIGSTOP');
  for (const name of ['path', 'landmarks', 'grid']) await shown(page, name).uncheck();
  // From now on the viewpoint stays fixed.
  await page.locator('#scene').focus();
  for (let i = 0; i < 4; ++i) await page.keyboard.press('-');
  const seen = [[await points(page), await filled(page)]], fewest = await landmarks(page);
  assert.ok(seen[0][1] > 500, `${seen[0]}`);
  while (seen.length < 3) {
    run.signal('SIGCONT');
    await page.waitForFunction((known) => Number(document.getElementById('scene').dataset.points) > known, seen.at(-1)[0]);
    run.signal('SIGSTOP');
    seen.push([await points(page), await filled(page)]);
    assert.ok(seen.at(-1)[1] > seen.at(-2)[1], `points and pixels: ${seen.join('; ')}`);
  }
  assert.ok((await landmarks(page)) > fewest, `${fewest} landmarks`);
  run.signal('SIGCONT');
  const late = await open(run.url);
  await drawn(late.page);
  assert.ok((await points(late.page)) >= seen.at(-1)[0]);
  await late.page.waitForSelector('#pictures[data-view]');
  await late.close();
  await close();
  await run.stop();
});

test('reports what happened', async () => {
  const {page, close} = await open(still.url);
  await says(page, 'connection', 'Finished');
  await says(page, 'tracking', 'tracking');
  // The motions add up to 12 and 8 mm, without rotation.
  const [, x, y] = (await page.locator('#pose').textContent()).match(/^Robot at (\S+), (\S+), \S+ m, rotated by 0\.[0-4]°$/);
  for (const [value, expected] of [[x, 0.012], [y, 0.008]]) assert.ok(Math.abs(Number(value) - expected) < 0.002, value);
  assert.deepEqual(await page.locator('#events li').allInnerTexts(),
    ['View 3: relocalized, lost since view 2', 'View 2: tracking lost']);
  await close();
});

test('pictures of the newest view, with landmarks, and those of the light when asked for', async () => {
  const {page, close} = await open(still.url);
  await says(page, 'connection', 'Finished');
  await page.waitForSelector('#pictures[data-view="5"]');
  const card = (name) => `figure.card:has(h3:text-is("${name}")) .frame`;
  for (const name of ['Texture', 'Depth']) assert.ok((await look(page, card(name))).colours > 50, name);
  const box = await page.locator(card('Depth')).boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  assert.match(await page.locator('figure.card:has(h3:text-is("Depth"))').innerText(), /(0|1)\.\d\d m|no depth/);
  assert.equal(await page.locator(card('Modulation')).isVisible(), false);
  await page.getByLabel('modulation and saturation').check();
  await page.locator(`${card('Saturation')} img`).waitFor();
  for (const name of ['Modulation', 'Saturation']) assert.ok((await look(page, card(name))).colours > 50, name);
  const size = await page.locator(`${card('Saturation')} img`).evaluate((image) => [image.naturalWidth, image.naturalHeight]);
  assert.deepEqual(size, [266, 250]);
  await close();
});

test('the map is coloured, turned, zoomed, followed and reset by keys', async () => {
  const {page, close} = await open(still.url);
  await drawn(page);
  let seen = await look(page, '.stage');
  assert.ok(seen.colours > 50, `only ${seen.colours} colours`);
  for (const colouring of ['height', 'sigma', 'texture']) {
    await page.getByLabel('colour', {exact: true}).selectOption(colouring);
    seen = await changed(page, '.stage', seen);
  }
  for (const name of ['path', 'landmarks', 'grid']) {
    await shown(page, name).uncheck();
    seen = await changed(page, '.stage', seen);
  }
  await page.locator('#scene').focus();
  for (const key of ['ArrowLeft', 'ArrowUp', 'Shift+ArrowRight', '+', '-', 'v', 'r']) {
    await page.keyboard.press(key);
    seen = await changed(page, '.stage', seen);
  }
  await page.keyboard.press('f');
  assert.ok(await page.getByLabel('follow the robot').isChecked());
  await close();
});

test('all that can be operated is reached by Tab and shows its focus', async () => {
  const {page, close} = await open(still.url);
  await drawn(page);
  const reached = await reachedByTab(page, 30);
  for (const id of ['theme', 'scene', 'look', 'reset']) assert.ok(reached.has(id), `${id}: ${[...reached]}`);
  await close();
});

test('it follows the system to the dark, and the button back', async () => {
  const {page, close} = await open(still.url, {colorScheme: 'dark'});
  await drawn(page);
  assert.ok((await darkness(page)) < 150);
  const dark = await look(page, '.stage');
  await page.locator('#theme').click();
  assert.ok((await darkness(page)) > 600);
  await changed(page, '.stage', dark);
  await close();
});

test('it fits a phone', async () => {
  const {page, close} = await open(still.url, {viewport: {width: 360, height: 740}, hasTouch: true, isMobile: true, deviceScaleFactor: 2});
  await drawn(page);
  await page.waitForSelector('#pictures[data-view]');
  assert.ok((await overflow(page)) <= 0, 'the page is wider than the phone');
  for (const id of ['#scene', '#pictures', '#tracking', '#events']) {
    const box = await page.locator(id).boundingBox();
    assert.ok(box.x >= 0 && box.x + box.width <= 360, `${id} sticks out`);
  }
  const before = await look(page, '.stage');
  await page.getByRole('button', {name: 'Camera view'}).tap();
  await changed(page, '.stage', before);
  await close();
});

test('a lost view is said to be; it goes on when the server is back, and with it the view is relocalized', async () => {
  const first = await live('first', kLost.slice(0, 2), '--live', '0');
  const {page, close} = await open(first.url, {expected: /ERR_CONNECTION|ERR_EMPTY_RESPONSE|ERR_SOCKET/});
  await says(page, 'connection', 'Finished');
  await drawn(page);
  assert.match(await page.locator('#name').textContent(), /first/);
  await says(page, 'tracking', 'lost');
  assert.match(await page.locator('#warnings').innerText(), /Tracking is lost/);
  assert.equal(await page.locator('#tracking.lost').count(), 1);
  await page.waitForSelector('#pictures[data-view="3"]');
  await first.stop();
  await says(page, 'connection', 'Ended; waiting for the next run');

  const second = await live('second', kLost.slice(0, 3), '--live', first.port);
  await says(page, 'connection', 'Finished');
  await drawn(page);
  assert.match(await page.locator('#name').textContent(), /second/);
  await says(page, 'tracking', 'relocalized');
  assert.equal(await page.locator('#warnings li').count(), 0);
  assert.match(await page.locator('#figures').innerText(), /4 of 4/);
  await page.waitForSelector('#pictures[data-view="4"]');
  await close();
  await second.stop();
});

test('beyond the computer it asks for the token that was printed', async () => {
  const run = await live('secret', [], '--live', '0', '--live-host', '0.0.0.0', '--live-token', kToken);
  assert.ok(run.url.endsWith(`/#token=${kToken}`), run.url);
  const address = `http://127.0.0.1:${run.port}/`;
  const asked = await open(address, {expected: /401/});
  await says(asked.page, 'connection', 'Token required');
  for (const [token, then] of [['a wrong one', 'Token required'], [kToken, 'Finished']]) {
    await asked.page.locator('#token').fill(token);
    await asked.page.keyboard.press('Enter');
    await says(asked.page, 'connection', then);
  }
  await asked.page.waitForSelector('#pictures[data-view]');
  await asked.close();

  const {page, close} = await open(`${address}#token=${kToken}`);
  await drawn(page);
  await page.waitForSelector('#pictures[data-view]');
  assert.equal(page.url(), address);  // the address in the browser does not show the token
  await page.reload();
  await drawn(page);
  await close();
  await run.stop();
});

test('more views than a call may have arguments are taken', async () => {
  const context = await browser.newContext({reducedMotion: 'reduce'});
  const page = await context.newPage();
  await page.route('**/snapshot', async (route) => {
    const answer = await route.fetch(), snapshot = await answer.json();
    const more = Array.from({length: 200000}, (_, i) => ({index: i + 5, timestamp_s: i + 5, tracking: 'lost'}));
    snapshot.views.list = snapshot.views.list.concat(more);
    return route.fulfill({response: answer, json: snapshot});
  });
  await page.goto(still.url);
  await page.waitForFunction(() => document.getElementById('figures').textContent.includes('200\u202f005'));
  await context.close();
});

test('victim candidates are listed and marked with their reason', async () => {
  const {page, close} = await open(still.url);
  await drawn(page);
  assert.equal(await page.locator('#candidates').isVisible(), false);
  await close();

  // Candidates as the server will send them.
  const context = await browser.newContext({reducedMotion: 'reduce'});
  const altered = await context.newPage();
  await altered.route('**/snapshot', async (route) => {
    const answer = await route.fetch();
    const candidates = [{position_m: [0, 0, 0.1], radius_m: 0.1, state: 'confirmed', victim: true, reason: '<b>34 °C</b> behind a box'}];
    return route.fulfill({response: answer, json: {...(await answer.json()), candidates}});
  });
  await altered.goto(still.url);
  await drawn(altered);
  assert.equal(await altered.locator('#candidate-list li').innerText(), '1: confirmed at 0.00, 0.00, 0.10 m, radius 0.10 m. <b>34 °C</b> behind a box');
  await altered.locator('#legend').getByText('may be a victim').waitFor();
  await context.close();
});
