// SPDX-License-Identifier: Apache-2.0
// The page of `fringeslam scene open` in a browser. FRINGESLAM_PROGRAM and FRINGESLAM_SOURCE_DIR select what is tested;
// files go to the current folder.
import assert from 'node:assert/strict';
import {spawnSync} from 'node:child_process';
import {existsSync, readFileSync, renameSync, rmSync, writeFileSync} from 'node:fs';
import {request} from 'node:http';
import {resolve} from 'node:path';
import {after, before, test} from 'node:test';
import {changed, darkness, kTimeoutMs, launch, look, open as openIn, overflow, reachedByTab, screenPixels} from './browser.mjs';
import {Runs, sceneText} from './runs.mjs';
import {killServed, serveProgram} from './served.mjs';

const kToken = 'correct-horse-battery';
const kMotions = [40, 40, -80].map((x) => `    - {translation_mm: [${x}, 0, 0], rotation_deg: [0, 0, 0]}\n`).join('');

const runs = new Runs(process.env.FRINGESLAM_PROGRAM, process.env.FRINGESLAM_SOURCE_DIR, resolve('scene'));
let browser, scene, served;

const serve = (...words) => serveScene(scene, ...words);

const serveScene = (place, ...words) => serveProgram(runs.program, ['scene', 'open', place, '--port', '0', ...words], 'scene');

// Starts a request; `answer` becomes {status, body}, or null after abort().
function begin(port, path, headers = {}, method = 'GET') {
  let sent;
  const answer = new Promise((done, failed) => {
    sent = request({host: '127.0.0.1', port, path, headers, method}, (answer) => {
      const parts = [];
      answer.on('data', (bytes) => parts.push(bytes));
      answer.on('end', () => done({status: answer.statusCode, body: Buffer.concat(parts)}));
    });
    sent.on('error', (error) => (sent.destroyed ? done(null) : failed(error)));
    sent.end();
  });
  return {answer, abort: () => sent.destroy()};
}
const status = async (...asked) => (await begin(...asked).answer).status;
const json = async (...asked) => JSON.parse((await begin(...asked).answer).body);
const stateOf = (port) => json(port, '/state');
const sceneOf = async (port) => json(port, `/scene/${(await stateOf(port)).scene}`);
const shown = (page, what) => page.waitForSelector(`#sensor-picture[data-shown="${what}"]`);

// The pixels of the picture shown in the sensor view: width, height and r g b a r g b a …
const pixels = (page) => page.evaluate(() => {
  const picture = document.querySelector('#sensor-picture > :not([hidden])');
  const [width, height] = [picture.naturalWidth ?? picture.width, picture.naturalHeight ?? picture.height];
  const context = new OffscreenCanvas(width, height).getContext('2d');
  context.drawImage(picture, 0, 0);
  return {width, height, data: [...context.getImageData(0, 0, width, height).data]};
});

const worldPixels = (page) => screenPixels(page, '.stage');

// Waits until the world looks as before, but for rounding and a line of its border, where the page is scrolled by part of
// a pixel. The limit corresponds to three lines of pixels.
async function drawnLike(page, before) {
  const end = Date.now() + kTimeoutMs;
  for (;;) {
    const now = await worldPixels(page);
    const other = now.filter((value, i) => Math.abs(value - before[i]) > 8).length;
    if (now.length === before.length && other < 4e-3 * now.length) return;
    assert.ok(Date.now() < end, `${other} of ${now.length} values differ`);
  }
}

// Returns the first view's depth of the plane z = 0 at a pixel.
function depthOfFloor({rig, path: [{camera}]}, x, y) {
  const [, , height, qx, qy, qz, qw] = camera;
  const [left, top] = rig.camera_corners[0], [right, bottom] = rig.camera_corners[2];
  const ray = [left + (x + 0.5) / rig.width_px * (right - left), top + (y + 0.5) / rig.height_px * (bottom - top), 1];
  const down = 2 * (qx * qz - qw * qy) * ray[0] + 2 * (qy * qz + qw * qx) * ray[1] + (1 - 2 * (qx * qx + qy * qy)) * ray[2];
  return -height / down;
}

async function open(url = served.url, options = {}) {
  const opened = await openIn(browser, url, options);
  await opened.page.waitForSelector('#scene[data-whole]', {state: 'attached'});
  return opened;
}

before(async () => {
  browser = await launch();
  scene = runs.scene('boxes', sceneText('boxes', 'the scene page', {count: 12, size: 0.24, motions: kMotions}));
  served = await serve();
}, {timeout: 2 * kTimeoutMs});
after(async () => {
  killServed();
  await browser?.close();
});

test('the world is drawn, and its objects are listed with name, material and pose', async () => {
  const {page, close} = await open();
  assert.ok((await look(page, '.stage')).colours > 50);
  assert.equal(await page.locator('#name').textContent(), 'boxes');
  const [, objects] = spawnSync(runs.program, ['scene', 'check', scene], {encoding: 'utf8'}).stdout.match(/(\d+) objects/);
  assert.equal(await page.locator('#object-list li').count(), Number(objects));
  const before = await look(page, '.stage');
  await page.locator('#object-list button').nth(0).click();
  await changed(page, '.stage', before);
  assert.match(await page.locator('#selected').innerText(), /table/);
  assert.equal(await page.locator('#object-list [aria-pressed=true]').count(), 1);
  await close();
});

test('a click into the world selects the object there, and dragging does not', async () => {
  const {page, close} = await open();
  const {x, y, width, height} = await page.locator('#scene').boundingBox();
  const [middleX, middleY] = [x + width / 2, y + height / 2];
  await page.mouse.move(middleX, middleY);
  await page.mouse.down();
  await page.mouse.move(middleX + 60, middleY);
  await page.mouse.up();
  assert.equal(await page.locator('#scene[data-selected]').count(), 0);
  await page.mouse.click(middleX, middleY);
  await page.waitForSelector('#scene[data-selected]');
  assert.match(await page.locator('#selected').innerText(), /table|cardboard/);
  await close();
});

test('the slider moves the rig, by keys too', async () => {
  const {page, close} = await open();
  assert.equal(await page.locator('#time').getAttribute('max'), '3');
  const before = await look(page, '.stage');
  await page.locator('#time').focus();
  await page.keyboard.press('ArrowRight');
  await changed(page, '.stage', before);
  assert.equal(await page.locator('#time-text').textContent(), 'view 1');
  await close();
});

test('the sensor view shows what the camera sees, reduced first and then in full', async () => {
  const {page, close} = await open();
  await shown(page, 'texture 0 full');
  const texture = await pixels(page);
  assert.deepEqual([texture.width, texture.height], [266, 250]);
  assert.ok(new Set(texture.data).size > 50);
  const asked = [];
  page.on('response', (answer) => answer.url().includes('/view/') && asked.push(answer.url()));
  await page.locator('#time').focus();
  await page.keyboard.press('ArrowRight');
  await shown(page, 'texture 1 full');
  assert.match(asked[0], /place=1&size=reduced/);
  assert.match(asked.at(-1), /place=1&size=full/);
  assert.equal(await page.locator('#sensor-state').textContent(), 'full size');
  assert.ok((await pixels(page)).data.some((value, i) => Math.abs(value - texture.data[i]) > 30));
  await close();
});

test('a pattern of the sensor view has its period', async () => {
  const {page, close} = await open();
  await page.locator('#sensor-kind').selectOption('pattern');
  assert.equal(await page.locator('#sensor-pattern option').count(), 9);
  assert.equal(await page.locator('#sensor-pattern option').nth(7).textContent(), '7: columns, period 16.5 px, shift 0°');
  // Number of changes between bright and dark along the row of the most changes.
  const changes = async () => {
    const {width, height, data} = await pixels(page);
    const most = Array.from({length: height}, (_, y) => {
      const row = Array.from({length: width}, (_, x) => data[4 * (y * width + x)]);
      const mean = row.reduce((sum, value) => sum + value) / width;
      return row.filter((value, x) => x > 0 && (value > mean) !== (row[x - 1] > mean)).length;
    });
    return most.sort((a, b) => a - b)[Math.floor(height / 2)];
  };
  const found = [];
  for (const pattern of ['4', '7']) {
    await page.locator('#sensor-pattern').selectOption(pattern);
    await shown(page, `pattern ${pattern} 0 full`);
    found.push(await changes());
  }
  assert.ok(found[1] > 4 * found[0], `${found}`);  // periods of 131 and 16.5 px
  await close();
});

test('the depth under the pointer is that of the table, or of a box upon it', async () => {
  const {page, close} = await open();
  await page.locator('#sensor-kind').selectOption('depth');
  await shown(page, 'depth 0 full');
  const data = await sceneOf(served.port);
  const {near_m: near, far_m: far, width_px: width, height_px: height} = data.rig;
  const step = (far - near) / 254 + 0.001;  // of levels, and of the text
  const {x, y, width: wide, height: high} = await page.locator('#sensor-picture').boundingBox();
  let table = 0;
  for (let i = 0; i < 49; ++i) {
    const [column, row] = [Math.floor(((i % 7) + 0.5) * width / 7), Math.floor((Math.floor(i / 7) + 0.5) * height / 7)];
    await page.mouse.move(x + (column + 0.5) * wide / width, y + (row + 0.5) * high / height);
    const depth = Number.parseFloat(await page.locator('#sensor-state').textContent());
    const floor = depthOfFloor(data, column, row);
    assert.ok(depth < floor + step, `${depth} ${floor}`);
    table += Math.abs(depth - floor) < step;
  }
  assert.ok(table > 8 && table < 49, `${table}`);
  await close();
});

test('the mask counts as many lit pixels as scene check', async () => {
  const {page, close} = await open();
  await page.locator('#sensor-kind').selectOption('mask');
  await shown(page, 'mask 0 full');
  const {data} = await pixels(page);
  const counts = new Map();
  for (let i = 0; i < data.length; i += 4) {
    const colour = data.slice(i, i + 3).join();
    counts.set(colour, (counts.get(colour) ?? 0) + 1);
  }
  const {views} = JSON.parse(spawnSync(runs.program, ['scene', 'check', scene, '--json'], {encoding: 'utf8'}).stdout);
  const key = await page.locator('.light-0').evaluate((node) => getComputedStyle(node).backgroundColor.match(/\d+/g).join());
  assert.ok(views[0].lit > 0.3 && views[0].lit < 1);
  assert.ok(Math.abs(counts.get(key) / (data.length / 4) - views[0].lit) < 1e-6, `${[...counts]} ${views[0].lit}`);
  assert.equal(counts.size, 2 + Number(counts.has('140,140,140')));
  await close();
});

test('indirect light, temperature and the risk of wrong orders are shown where a scene has them', async () => {
  const kinds = (page) => page.locator('#sensor-kind option').evaluateAll((list) => list.map(({value}) => value));
  const {page, close} = await open();
  assert.deepEqual(await kinds(page), ['texture', 'pattern', 'depth', 'mask', 'wrong_order']);
  // The mean of green grows with the risk.
  const risk = async (page) => {
    await page.locator('#sensor-kind').selectOption('wrong_order');
    await shown(page, 'wrong_order 0 full');
    const {data} = await pixels(page);
    const known = data.filter((_, i) => i % 4 === 1 && data[i + 2] > 0);
    assert.ok(known.length > 0.01 * data.length / 4);
    return known.reduce((sum, value) => sum + value) / known.length;
  };
  const bright = await risk(page);
  await close();

  const warm = await serve('--with', 'light.bounces=2', '--with', 'materials.cardboard.warmer_k=10', '--with', 'light.exposure_s=2e-4');
  const other = await open(warm.url);
  const dark = await risk(other.page);
  assert.ok(dark > bright + 1, `${dark} ${bright}`);
  assert.deepEqual((await kinds(other.page)).slice(5), ['indirect', 'temperature']);
  await other.page.locator('#sensor-kind').selectOption('temperature');
  await shown(other.page, 'temperature 0 full');
  assert.deepEqual(await other.page.locator('.colour-key .ends span').allTextContents(), ['20.0 °C', '25.0 °C', '30.0 °C']);
  // The ends of the palette: ground and boxes.
  const {data} = await pixels(other.page);
  const seen = new Set();
  for (let i = 0; i < data.length; i += 4) if (data[i + 3]) seen.add(data.slice(i, i + 3).join());
  assert.deepEqual([...seen].sort(), ['0,34,78', '254,232,56']);
  await other.page.locator('#sensor-kind').selectOption('indirect');
  await shown(other.page, 'indirect 0 full');
  assert.ok(new Set((await pixels(other.page)).data).size > 20);
  await other.close();
  await warm.stop('SIGTERM');
});

test('textures cover the world, in tiles along the axes or by the coordinates of a mesh', async () => {
  const place = runs.scene('textured', `name: textured
description: A texture with a black and a white half
seed: 1
rig: {file: rig.yaml}
patterns: {axis: columns, steps: 3, periods_px: [1040, 131, 16.5], bits: 8}
materials:
  halves: {texture: halves.pgm, texture_m: 0.8, albedo: 0.9}
objects:
  - {shape: plane, size_m: [0.8, 0.8], material: halves}
  - {shape: mesh, file: tilted.obj, material: halves, pose: {translation_m: [0, 0, 0.1]}}
trajectory: {interval_s: 0.5}
`);
  const width = 64;
  const halves = Buffer.alloc(width * width, 0).map((_, i) => (i % width < width / 2 ? 0 : 255));
  writeFileSync(runs.at('textured', 'halves.pgm'), Buffer.concat([Buffer.from(`P5 ${width} ${width} 255\n`), halves]));
  // A small square whose coordinates show the white half alone.
  writeFileSync(runs.at('textured', 'tilted.obj'), `v -0.1 -0.1 0\nv 0.1 -0.1 0\nv 0.1 0.1 0\nv -0.1 0.1 0
vt 0.6 0.1\nvt 0.9 0.1\nvt 0.9 0.9\nvt 0.6 0.9\nf 1/1 2/2 3/3 4/4\n`);
  const textured = await serveScene(place);
  const data = await sceneOf(textured.port);
  assert.deepEqual(data.objects.map(({tile}) => tile), [0, 0]);
  assert.deepEqual(data.tiles.map(({size_m, edge, centered}) => [size_m, edge, centered]), [[0.8, 'repeat', false]]);
  const {page, close} = await open(textured.url);
  const values = (await worldPixels(page)).filter((_, i) => i % 4 === 0);
  const dark = values.filter((value) => value < 20).length, bright = values.filter((value) => value > 150 && value < 235).length;
  assert.ok(dark > 0.01 * values.length, `${dark} of ${values.length}`);
  assert.ok(bright > dark / 2, `${bright} ${dark}`);
  await close();
  await textured.stop('SIGTERM');
});

test('a world of more than ten million triangles is thinned and drawn', async () => {
  const place = runs.scene('triangles', `name: triangles
description: 32 rocks of 330,000 triangles
seed: 1
rig: {file: rig.yaml}
patterns: {axis: columns, steps: 3, periods_px: [1040, 131, 16.5], bits: 8}
materials:
  stone: {grain: stone, albedo: 0.5, contrast: 0.4, grain_m: 0.02}
objects:
${[...Array(32).keys()].map((i) => `  - {shape: rock, size_m: [0.05, 0.04, 0.04], detail: 7, material: stone, pose: {translation_m: [${((i % 8) - 3.5) / 20}, ${(Math.floor(i / 8) - 1.5) / 20}, 0.02]}}`).join('\n')}
trajectory: {interval_s: 0.5}
`);
  const large = await serveScene(place);
  const {triangles, drawn_triangles: drawn} = await sceneOf(large.port);
  assert.ok(triangles > 1e7, triangles);
  assert.ok(drawn > 3e5 && drawn < 2e6, drawn);
  const {page, close} = await open(large.url);
  assert.ok((await look(page, '.stage')).colours > 50);
  assert.match(await page.locator('#about').textContent(), new RegExp(`32 objects, ${triangles} triangles, of which ${drawn} are drawn`));
  await close();
  await large.stop('SIGTERM');
});

test('a rendering stops when a newer view is wanted, and delays no other answer', async () => {
  const slow = await serve('--with', 'light.bounces=20');
  const {scene: number} = await stateOf(slow.port);
  const full = `/view/texture.png?scene=${number}&place=0&size=full`, reduced = `/view/texture.png?scene=${number}&place=1&size=reduced`;
  await begin(slow.port, reduced).answer;
  const start = performance.now();
  const first = begin(slow.port, full).answer;
  const order = [];
  await Promise.all([first.then(() => order.push('view')), begin(slow.port, `/scene/${number}`).answer.then(() => order.push('scene'))]);
  assert.deepEqual(order, ['scene', 'view']);
  const whole = performance.now() - start;
  for (let i = 0; i < 5; ++i) {
    const given_up = begin(slow.port, full);
    await new Promise((done) => setTimeout(done, 20));
    given_up.abort();
    assert.equal(await given_up.answer, null);
  }
  const again = performance.now();
  assert.equal(await status(slow.port, reduced), 200);
  const taken = performance.now() - again;
  assert.ok(taken < 2 * whole, `${taken} ms, a whole picture ${whole} ms`);  // five of them otherwise

  const {page, close} = await open(slow.url);
  const cancelled = [];
  page.on('requestfailed', (asked) => cancelled.push(asked.url()));
  await page.locator('#time').focus();
  const began = page.waitForRequest(/size=full/);
  await page.keyboard.press('ArrowRight');
  await began;
  await page.keyboard.press('ArrowRight');
  await shown(page, 'texture 2 full');
  assert.match(cancelled.at(-1), /place=1&size=full/);
  await close();
  await slow.stop('SIGTERM');
});

test('views that do not exist are refused', async () => {
  const {scene: number} = await stateOf(served.port);
  for (const [query, expected] of [['texture.png?place=0&size=reduced', 200], ['texture.png?place=4&size=full', 404], ['texture.png?place=-1&size=full', 400],
    ['texture.png?place=0', 400], ['heat.png?place=0&size=full', 404], ['pattern.png?place=0&size=full&pattern=9', 404], ['pattern.png?place=0&size=full', 400]]) {
    assert.equal(await status(served.port, `/view/${query}&scene=${number}`), expected, query);
  }
  assert.equal(await status(served.port, '/view/texture.png?place=0&size=reduced'), 400);
  assert.equal(await status(served.port, `/view/texture.png?place=0&size=reduced&scene=${number - 1}`), 204);
});

test('a page of another origin, another host name and a viewer without token are refused', async () => {
  assert.equal(await status(served.port, '/state'), 200);
  assert.equal(await status(served.port, '/state', {Host: 'evil.example'}), 403);
  assert.equal(await status(served.port, '/state', {Origin: 'http://evil.example'}), 403);
  assert.equal(await status(served.port, '/mesh/99999'), 404);
  const open_to_all = await serve('--live-host', '0.0.0.0', '--live-token', kToken);
  const {scene: number} = await json(open_to_all.port, '/state', {Authorization: `Bearer ${kToken}`});
  const {objects: [{mesh}]} = await json(open_to_all.port, `/scene/${number}`, {Authorization: `Bearer ${kToken}`});
  for (const path of ['/state', `/scene/${number}`, `/mesh/${mesh}`, `/view/depth.png?scene=${number}&place=0&size=reduced`]) {
    assert.equal(await status(open_to_all.port, path), 401, path);
    assert.equal(await status(open_to_all.port, path, {Authorization: `Bearer ${kToken}`}), 200, path);
  }
  const {page, close} = await open(`http://127.0.0.1:${open_to_all.port}/#token=${kToken}`);
  assert.ok((await look(page, '.stage')).colours > 50);
  await close();
  await open_to_all.stop('SIGTERM');
});

// A scene that includes its materials, and its page. `edit` replaces text of a file and returns the time until the page
// shows the new scene, ms.
async function edited(name) {
  const materials = (albedo) => `materials:\n  table: {grain: plain, albedo: ${albedo}, contrast: 0, grain_m: 0.01}\n`;
  const text = sceneText(name, 'the scene page', {count: 12, size: 0.24, motions: kMotions});
  const place = runs.scene(name, text.replace(/ {2}table: .*\n/, '').replace('materials:', 'include: materials.yaml\nmaterials:'));
  const file = (which) => runs.at(name, which);
  writeFileSync(file('materials.yaml'), materials(0.4));
  const server = await serveScene(place);
  const opened = await open(server.url);
  const {page} = opened;
  return {
    ...opened, server, file,
    async edit(which, from, to) {
      const before = await page.locator('#scene').getAttribute('data-whole');
      const text = readFileSync(file(which), 'utf8').replace(from, to);
      const start = performance.now();
      writeFileSync(file(which), text);
      await page.waitForSelector(`#scene[data-whole]:not([data-whole="${before}"])`, {state: 'attached'});
      return performance.now() - start;
    },
    async done() {
      await opened.close();
      await server.stop('SIGTERM');
    },
  };
}

test('changes of the scene and of included files appear in the page, and the view stays', async (t) => {
  const {page, edit, file, server, done} = await edited('changes');
  await shown(page, 'texture 0 full');
  const count = await page.locator('#object-list li').count();
  await page.locator('#time').focus();
  await page.keyboard.press('ArrowRight');
  await shown(page, 'texture 1 full');
  await page.locator('#scene').focus();
  await page.keyboard.press('ArrowLeft');
  const unselected = await look(page, '.stage');
  await page.locator('#object-list button').nth(0).click();
  await changed(page, '.stage', unselected);
  const [world, drawn, seen] = [await look(page, '.stage'), await worldPixels(page), await pixels(page)];

  t.diagnostic(`included file: ${Math.round(await edit('materials.yaml', 'albedo: 0.4', 'albedo: 0.8'))} ms`);
  const {objects} = await sceneOf(server.port);
  assert.equal(objects[0].albedo, 0.8);
  const number = await page.locator('#scene').getAttribute('data-whole');
  await page.waitForSelector(`#sensor-picture[data-scene="${number}"][data-shown="texture 1 full"]`);
  const mean = ({data}) => data.reduce((sum, value) => sum + value) / data.length;
  assert.ok(mean(await pixels(page)) > mean(seen) + 5);
  assert.equal(await page.locator('#object-list [aria-pressed=true]').count(), 1);
  await drawnLike(page, drawn);  // the table is selected, and the viewpoint is the same

  t.diagnostic(`scene file: ${Math.round(await edit('scene.yaml', 'count: 12', 'count: 3'))} ms`);
  assert.ok((await page.locator('#object-list li').count()) < count);
  await changed(page, '.stage', world);

  t.diagnostic(`rig: ${Math.round(await edit('rig.yaml', 'height_px: 250', 'height_px: 125'))} ms`);
  await page.waitForFunction(() => document.querySelector('#sensor-picture img').naturalHeight === 125);

  // Editors write another file and rename it.
  const before = await page.locator('#scene').getAttribute('data-whole');
  writeFileSync(file('new'), readFileSync(file('scene.yaml'), 'utf8').replace('interval_s: 0.5', 'interval_s: 0.25').replace('name: changes', 'name: renamed'));
  renameSync(file('new'), file('scene.yaml'));
  await page.waitForSelector(`#scene[data-whole]:not([data-whole="${before}"])`, {state: 'attached'});
  await page.waitForFunction(() => document.getElementById('name').textContent === 'renamed');
  await done();
});

test('an error in a file is shown with line and nearest key, beside the last valid world', async () => {
  const {page, edit, file, done} = await edited('errors');
  const [count, drawn] = [await page.locator('#object-list li').count(), await worldPixels(page)];
  const error = page.locator('#scene-error');
  const wrong = async (which, from, to, expected) => {
    const right = readFileSync(file(which), 'utf8');
    writeFileSync(file(which), right.replace(from, to));
    await page.waitForFunction((text) => new RegExp(text).test(document.getElementById('scene-error').textContent), expected.source);
    assert.ok(await error.isVisible());
    assert.equal(await page.locator('#object-list li').count(), count);
    writeFileSync(file(which), right);
    await error.waitFor({state: 'hidden'});
  };
  await wrong('scene.yaml', 'ambient_lux', 'ambient_lx', /scene\.yaml:\d+: .*ambient_lx.*ambient_lux/);
  await wrong('materials.yaml', 'albedo: 0.4', 'albedo: 4', /materials\.yaml:2: .*albedo/);
  await wrong('rig.yaml', 'fx_px', 'fx_pixels', /rig\.yaml:\d+: /);
  await wrong('scene.yaml', 'seed: 3', 'seed: [', /scene\.yaml:\d+: /);
  await drawnLike(page, drawn);
  rmSync(file('materials.yaml'));
  await page.waitForFunction(() => /materials\.yaml does not exist/.test(document.getElementById('scene-error').textContent));
  assert.equal(await page.locator('#object-list li').count(), count);
  writeFileSync(file('materials.yaml'), 'materials:\n  table: {grain: plain, albedo: 0.1, contrast: 0, grain_m: 0.01}\n');
  await error.waitFor({state: 'hidden'});
  await edit('scene.yaml', 'count: 12', 'count: 2');
  await done();
});

test('a new seed draws another world, which the command shown opens again', async () => {
  const server = await serve('--with', 'light.ambient_lux={uniform: [1, 2]}');
  const {page, close} = await open(server.url);
  const about = () => page.locator('#about').textContent();
  assert.match(await about(), /^seed 3,/);
  const [first, before] = [await sceneOf(server.port), await look(page, '.stage')];
  const whole = await page.locator('#scene').getAttribute('data-whole');
  await page.locator('#new-seed').focus();
  await page.keyboard.press('Enter');
  await page.waitForSelector(`#scene[data-whole]:not([data-whole="${whole}"])`, {state: 'attached'});
  await changed(page, '.stage', before);
  const [, seed] = (await about()).match(/^seed (\d+),/);
  assert.notEqual(seed, '3');
  const command = await page.locator('#command code').textContent();
  assert.equal(command, `fringeslam scene open ${scene} --seed ${seed} --with 'light.ambient_lux={uniform: [1, 2]}'`);
  const second = await sceneOf(server.port);
  assert.notDeepEqual(second.objects, first.objects);
  await page.context().grantPermissions(['clipboard-read', 'clipboard-write']);
  await page.locator('#command button').click();
  assert.equal(await page.evaluate(() => navigator.clipboard.readText()), command);
  await close();
  await server.stop('SIGTERM');
  const again = await serve('--seed', seed);
  assert.deepEqual((await sceneOf(again.port)).objects, second.objects);
  await again.stop('SIGTERM');
});

// Waits until all views of the scene shown are assessed.
const assessed = (page) => page.waitForFunction(() => {
  const number = document.getElementById('scene').dataset.whole;
  return number && document.getElementById('difficulty-state').dataset.done === number;
});

test('the difficulty along the path agrees with scene check, and nothing is red in an easy scene', async () => {
  const {page, close} = await open();
  await assessed(page);
  const {views} = JSON.parse(spawnSync(runs.program, ['scene', 'check', scene, '--difficulty', '--json'], {encoding: 'utf8'}).stdout);
  const {scene: number} = await stateOf(served.port);
  const answer = await json(served.port, `/difficulty?scene=${number}&known=0`);
  assert.deepEqual([answer.total, answer.done, answer.views], [4, true, views]);
  assert.match(await page.locator('#difficulty-state').textContent(), /4 views assessed; none beyond a limit/);
  assert.equal(await page.locator('#difficulty-list li').count(), 0);
  assert.equal(await page.locator('#difficulty-plots .curve').count(), 7);
  assert.match(await page.locator('#scene').getAttribute('data-levels'), /^[01]{4}$/);
  assert.equal(await status(served.port, `/difficulty?scene=${number - 1}&known=0`), 204);
  assert.equal(await status(served.port, '/difficulty?known=0'), 400);
  await close();
});

test('a view beyond the range is red, with the reason, and a click shows it', async () => {
  const place = runs.scene('far', sceneText('far', 'the scene page', {count: 12, size: 0.24,
    motions: '    - {translation_mm: [20, 0, 0], rotation_deg: [0, 0, 0]}\n    - {translation_mm: [0, 0, 900], rotation_deg: [0, 0, 0]}\n'}));
  const server = await serveScene(place);
  const {page, close} = await open(server.url);
  await assessed(page);
  const levels = await page.locator('#scene').getAttribute('data-levels');
  assert.match(levels, /^[01]{2}2$/);
  const before = await look(page, '.stage');
  await page.locator('#path-colour').selectOption('repetition');
  assert.match(await page.locator('#scene').getAttribute('data-levels'), /^000$/);
  await changed(page, '.stage', before);
  await page.locator('#path-colour').selectOption('worst');
  const stretch = page.locator('#difficulty-list button', {hasText: 'Range, view 2'});
  assert.match(await stretch.innerText(), /beyond far_m/);
  await stretch.click();
  assert.equal(await page.locator('#time-text').textContent(), 'view 2');
  assert.match(await page.locator('#difficulty-here').innerText(), /Range: only \d+ % of the pixels are lit and in range/);
  await close();
  await server.stop('SIGTERM');
});

test('distributions are listed with the values drawn, and any number can be changed, as by --with', async () => {
  const server = await serve('--with', 'light.ambient_lux={uniform: [100, 300]}');
  const {page, close} = await open(server.url);
  const row = (path) => page.locator(`.value-row[data-path="${path}"]`);
  assert.equal(await page.locator('.value-row').count(), 1);
  const drawn = Number(await row('light.ambient_lux').locator('.number').inputValue());
  assert.ok(drawn > 100 && drawn < 300, `${drawn}`);
  assert.match(await row('light.ambient_lux').innerText(), /from \{uniform: \[100, 300\]\}/);

  const shows = async (what) => page.waitForFunction((text) => document.querySelector('#command code').textContent.endsWith(text), what);
  const whole = () => page.locator('#scene').getAttribute('data-whole');
  let before = await whole();
  const other = () => page.waitForSelector(`#scene[data-whole]:not([data-whole="${before}"])`, {state: 'attached'});
  const slider = row('light.ambient_lux').locator('input[type=range]');
  await slider.focus();
  await page.keyboard.press('End');
  await other();
  await shows('--with light.ambient_lux=300');
  assert.equal(await row('light.ambient_lux').locator('.number').inputValue(), '300');

  before = await whole();
  await page.locator('#values-filter').fill('objects.1.count');
  await row('objects.1.count').locator('.number').fill('3');
  await page.keyboard.press('Enter');
  await other();
  await shows('--with objects.1.count=3');
  assert.equal((await sceneOf(server.port)).objects.length, 4);

  // A bad value is an error of one line, beside the last valid world.
  await row('objects.1.count').locator('.number').fill('-5');
  await page.keyboard.press('Enter');
  await page.waitForFunction(() => /'count' is -5|'count'.*-5/.test(document.getElementById('scene-error').textContent));
  assert.equal((await sceneOf(server.port)).objects.length, 4);
  await row('objects.1.count').locator('.undo').click();
  await page.locator('#scene-error').waitFor({state: 'hidden'});
  await page.waitForFunction(() => document.querySelectorAll('#object-list li').length > 4);
  await page.locator('#values-reset').click();
  await page.waitForFunction(() => document.getElementById('values-reset').hidden);

  const command = await page.locator('#command code').textContent();
  assert.match(command, /--with 'light.ambient_lux=\{uniform: \[100, 300\]\}'$/);
  assert.equal(await status(server.port, '/value?path=light.ambient_lux&value=1', {Origin: 'http://evil.example'}, 'POST'), 403);
  assert.equal(await status(server.port, '/value?value=1', {}, 'POST'), 400);
  await close();
  await server.stop('SIGTERM');
});

test('what is moved goes to placed.yaml, which scene check accepts, and the author\'s file stays', async () => {
  const text = sceneText('placed', 'the scene page', {count: 3, size: 0.24, motions: kMotions})
    .replace('materials:', '# A comment of the author.\nmaterials:')
    .replace('trajectory:', '  - {shape: box, size_m: [0.1, 0.1, 0.1], material: cardboard, pose: {translation_m: [0, 0.1, 0.05]}}\ntrajectory:\n  start: {translation_m: [0, 0, 0.02]}');
  const place = runs.scene('placed', text), file = (name) => resolve(place, name);
  const server = await serveScene(place);
  const {page, close} = await open(server.url);
  const box = await page.locator('#object-list li').count() - 1;
  await page.locator('#object-list button').nth(box).click();
  const z = page.locator('#move input').nth(2);
  assert.equal(await z.inputValue(), '0.05');
  await z.fill('0.2');
  await page.keyboard.press('Enter');
  await page.waitForFunction(() => /scene\.yaml: add `include: placed\.yaml`/.test(document.getElementById('place-error').textContent));
  assert.match(readFileSync(file('placed.yaml'), 'utf8'), /^# Written by `fringeslam scene open`/);

  const whole = () => page.locator('#scene').getAttribute('data-whole');
  let before = await whole();
  const other = () => page.waitForSelector(`#scene[data-whole]:not([data-whole="${before}"])`, {state: 'attached'});
  const included = text.replace('seed: 3', 'seed: 3\ninclude: placed.yaml');
  writeFileSync(file('scene.yaml'), included);
  await other();
  before = await whole();
  await z.fill('0.2');
  await page.keyboard.press('Enter');
  await other();
  assert.ok(await page.locator('#place-error').isHidden());
  const position = async () => (await sceneOf(server.port)).objects[box].pose.slice(0, 3);
  assert.deepEqual(await position(), [0, 0.1, 0.2]);

  // By its arrow, whose tip is to the right of the box or to its left.
  before = await whole();
  await page.locator('.stage').scrollIntoViewIfNeeded();
  const {x: left, y: top, width, height} = await page.locator('#scene').boundingBox();
  const grip = await page.evaluate(() => document.getElementById('scene').dataset.grip.split(',').map(Number));
  const [gripX, gripY] = [left + grip[0] * width, top + grip[1] * height];
  await page.mouse.move(gripX, gripY);
  await page.mouse.down();
  await page.mouse.move(gripX + 20, gripY + 10, {steps: 4});
  await page.mouse.move(gripX + 60, gripY + 30, {steps: 8});
  await page.mouse.up();
  await other();
  const dragged = await position();
  assert.ok(Math.abs(dragged[0]) > 0.01, `${dragged}`);
  assert.ok(Math.abs(dragged[1] - 0.1) < 1e-9 && Math.abs(dragged[2] - 0.2) < 1e-9, `${dragged}`);

  // A new version of the scene does not replace what is being typed.
  await z.fill('0.7');
  for (const version of [included.replace('ambient_lux: 290', 'ambient_lux: 280'), included]) {
    before = await whole();
    writeFileSync(file('scene.yaml'), version);
    await other();
    assert.equal(await z.inputValue(), '0.7');
  }

  // The start of the trajectory, and a second entry beside the first.
  assert.equal(await status(server.port, '/place?path=trajectory.start.translation_m&x=0.03&y=0&z=0.02', {}, 'POST'), 200);
  await page.waitForFunction(() => document.querySelector('#scene').dataset.whole);
  const {status: code, stdout, stderr} = spawnSync(runs.program, ['scene', 'check', place], {encoding: 'utf8'});
  assert.equal(code, 0, stdout + stderr);
  const placed = readFileSync(file('placed.yaml'), 'utf8');
  assert.match(placed, /objects\.2\.pose\.translation_m: \[/);
  assert.match(placed, /trajectory\.start\.translation_m: \[0\.03, 0, 0\.02\]/);
  assert.equal(readFileSync(file('scene.yaml'), 'utf8'), included);

  // A file of the author's is never replaced.
  writeFileSync(file('placed.yaml'), '# Mine.\nplaced: {}\n');
  const {error} = await json(server.port, '/place?path=objects.2.pose.translation_m&x=0&y=0&z=0', {}, 'POST');
  assert.match(error, /placed\.yaml: was not written by this program/);
  assert.equal(readFileSync(file('placed.yaml'), 'utf8'), '# Mine.\nplaced: {}\n');
  assert.match((await json(server.port, '/place?path=light.ambient_lux&x=0&y=0&z=0', {}, 'POST')).error, /./);
  assert.equal(await status(server.port, '/place?path=objects.2.pose.translation_m&x=0&y=0', {}, 'POST'), 400);
  assert.equal(await status(server.port, '/place?path=objects.2.pose.translation_m&x=0&y=0&z=0', {Origin: 'http://evil.example'}, 'POST'), 403);
  await close();
  await server.stop('SIGTERM');
});

test('what a failed load had drawn does not stay in the world', async () => {
  const text = sceneText('torn', 'the scene page', {count: 3, size: 0.24, motions: kMotions});
  const place = runs.scene('torn', text);
  const server = await serveScene(place);
  const {page, close} = await open(server.url, {expected: /ERR_FAILED/});
  // The table arrives, the next mesh does not.
  let meshes = 0;
  await page.route('**/mesh/*', (route) => (++meshes === 2 ? route.abort() : route.continue()));
  await page.reload();
  await page.waitForSelector('#scene[data-whole]', {state: 'attached'});
  assert.ok(meshes > 2);
  const before = await page.locator('#scene').getAttribute('data-whole');
  writeFileSync(resolve(place, 'scene.yaml'), text.replace('size_m: [0.8, 0.8]', 'size_m: [0.3, 0.3]'));
  await page.waitForSelector(`#scene[data-whole]:not([data-whole="${before}"])`, {state: 'attached'});
  const fresh = await open(server.url);
  for (const each of [fresh.page, page]) await assessed(each);
  await drawnLike(page, await worldPixels(fresh.page));
  await fresh.close();
  await close();
  await server.stop('SIGTERM');
});

test('a selected object shows the line of its entry', async () => {
  const {page, close} = await open();
  await page.locator('#object-list button').nth(3).click();
  const line = readFileSync(resolve(scene, 'scene.yaml'), 'utf8').split('\n').findIndex((text) => text.includes('shape: scatter')) + 1;
  assert.match(await page.locator('#selected').innerText(), new RegExp(`scene\\.yaml:${line}\\b`));
  await close();
});

// A gallery of two valid scenes and an invalid one.
async function serveGallery(name, ...words) {
  const folder = runs.at(name);
  const gallery = new Runs(runs.program, runs.source, folder);
  for (const scene of ['first', 'second']) gallery.scene(scene, sceneText(scene, `the ${scene} test`, {count: 3, size: 0.2, motions: ''}));
  gallery.scene('wrong', 'name: wrong\ndescription: Not a scene\nobjets: []\n');
  return {folder, ...await serveProgram(runs.program, ['scene', 'list', '--in', folder, '--page', '0', ...words], 'scenes')};
}

test('the gallery shows all scenes with pictures, finds them, and opens them or says why not', async () => {
  const gallery = await serveGallery('gallery');
  const {page, close} = await openIn(browser, gallery.url, {others: /^http:\/\/127\.0\.0\.1:\d+\//});
  await page.waitForSelector('li[data-scene=second] img[data-state=drawn]');
  await page.waitForSelector('li[data-scene=wrong] img[data-state=failed]', {state: 'attached'});
  assert.deepEqual(await page.locator('#scenes h3').allTextContents(), ['first', 'second', 'wrong']);
  assert.ok((await look(page, 'li[data-scene=first] img')).colours > 50);
  await page.locator('#filter').fill('second');
  assert.equal(await page.locator('#scenes li:visible').count(), 1);
  await page.locator('#filter').fill('');
  await page.locator('li[data-scene=wrong] button').click();
  const why = page.locator('li[data-scene=wrong] [role=alert]');
  await why.waitFor();
  assert.match(await why.textContent(), /wrong\/scene\.yaml:1: /);
  await page.locator('li[data-scene=second] button').click();
  await page.waitForURL((url) => url.port !== gallery.port);
  await page.waitForSelector('#scene[data-whole]', {state: 'attached'});
  assert.equal(await page.locator('#name').textContent(), 'second');
  await close();
  await gallery.stop('SIGTERM');
});

test('a gallery whose port is taken ends with a message', async () => {
  const gallery = await serveGallery('taken');
  const {status: code, stderr} = spawnSync(runs.program, ['scene', 'list', '--in', gallery.folder, '--page', gallery.port], {encoding: 'utf8', timeout: kTimeoutMs});
  assert.equal(code, 2, stderr);
  assert.match(stderr, /port \d+ is in use/);
  await gallery.stop('SIGTERM');
});

test('a mesh dropped onto the gallery becomes a scene that scene check accepts', async () => {
  const gallery = await serveGallery('meshes');
  const {page, close} = await openIn(browser, gallery.url);
  await page.waitForSelector('li[data-scene=first]');
  // A tetrahedron of 120 units, more than a scene in metres would be: millimetres.
  const tetrahedron = 'v 0 0 0\nv 120 0 0\nv 0 120 0\nv 0 0 120\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n';
  const drop = (name, text) => page.evaluate(([name, text]) => {
    const data = new DataTransfer();
    data.items.add(new File([text], name));
    document.querySelector('#drop').dispatchEvent(new DragEvent('drop', {dataTransfer: data, bubbles: true, cancelable: true}));
  }, [name, text]);
  const said = async (pattern) => {
    await page.waitForFunction((source) => new RegExp(source).test(document.querySelector('#mesh-state').textContent), pattern.source);
  };
  await drop('my tetra.obj', tetrahedron);
  await said(/Created my_tetra/);
  await page.waitForSelector('li[data-scene=my_tetra] img[data-state=drawn]');
  const made = resolve(gallery.folder, 'my_tetra');
  const text = readFileSync(resolve(made, 'scene.yaml'), 'utf8');
  assert.match(text, /unit_m: 0\.001/);
  const {status: code, stdout, stderr} = spawnSync(runs.program, ['scene', 'check', made, '--json'], {encoding: 'utf8'});
  assert.equal(code, 0, stderr);
  for (const {surface, in_range: inRange} of JSON.parse(stdout).views) assert.ok(surface > 0.9 && inRange > 0.9, stdout);
  // Again: nothing is replaced.
  await drop('my tetra.obj', tetrahedron);
  await said(/exists already/);
  await drop('broken.obj', 'v 0 0\nf 1 2 3\n');
  await said(/^broken\.obj: /);
  assert.ok(!existsSync(resolve(gallery.folder, 'broken')));
  // Neither a foreign page nor a huge file creates one.
  assert.equal(await status(gallery.port, '/mesh?file=a.obj', {Origin: 'http://example.com'}, 'POST'), 403);
  const huge = {'Content-Length': String(2 ** 30)};
  assert.equal(await status(gallery.port, '/mesh?file=a.obj', huge, 'POST'), 413);
  await close();
  await gallery.stop('SIGTERM');
});

test('only the page may order a new seed', async () => {
  const {number} = await stateOf(served.port);
  assert.equal(await status(served.port, '/seed', {Origin: 'http://evil.example'}, 'POST'), 403);
  assert.equal(await status(served.port, '/seed', {Host: 'evil.example'}, 'POST'), 403);
  assert.equal(await status(served.port, '/seed'), 404);
  assert.equal(await status(served.port, '/state', {}, 'POST'), 405);
  assert.equal(await status(served.port, '/state', {}, 'PUT'), 405);
  assert.equal((await stateOf(served.port)).number, number);
  const guarded = await serve('--live-host', '0.0.0.0', '--live-token', kToken);
  assert.equal(await status(guarded.port, '/seed', {}, 'POST'), 401);
  assert.equal(await status(guarded.port, '/seed', {Authorization: `Bearer ${kToken}`}, 'POST'), 200);
  await guarded.stop('SIGTERM');
});

test('Ctrl-C ends it with success', async () => {
  const other = await serve();
  assert.equal(await other.stop('SIGINT'), 0);
});

test('an invalid scene is reported with its line, exit code 2', () => {
  const file = runs.at('wrong.yaml');
  writeFileSync(file, 'name: wrong\nobjets: []\n');
  const {status: code, stderr} = spawnSync(runs.program, ['scene', 'open', file, '--port', '0'], {encoding: 'utf8', timeout: kTimeoutMs});
  assert.equal(code, 2, stderr);
  assert.match(stderr, /wrong\.yaml/);
});

test('all that can be operated is reached by Tab and shows its focus', async () => {
  const {page, close} = await open();
  const reached = await reachedByTab(page, 12);
  for (const id of ['theme', 'new-seed', 'scene', 'time', 'reset', 'sensor-kind']) assert.ok(reached.has(id), `${id}: ${[...reached]}`);
  await close();
});

test('it follows the system to the dark, and fits a phone', async () => {
  const {page, close} = await open(served.url, {colorScheme: 'dark', viewport: {width: 360, height: 740}, isMobile: true, hasTouch: true});
  assert.ok((await darkness(page)) < 150);
  await page.locator('#sensor-kind').selectOption('pattern');  // with the longest texts
  await shown(page, 'pattern 0 0 full');
  const {x, width} = await page.locator('#sensor-pattern').boundingBox();
  assert.ok(x >= 0 && x + width <= 360, `${x} ${width}`);
  assert.ok((await overflow(page)) <= 0, 'the page is wider than the phone');
  await close();
});
