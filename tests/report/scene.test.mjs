// SPDX-License-Identifier: Apache-2.0
// The page of `fringeslam scene open` in a browser. FRINGESLAM_PROGRAM and FRINGESLAM_SOURCE_DIR select what is tested;
// files go to the current folder.
import assert from 'node:assert/strict';
import {spawn, spawnSync} from 'node:child_process';
import {writeFileSync} from 'node:fs';
import {request} from 'node:http';
import {resolve} from 'node:path';
import {after, before, test} from 'node:test';
import {changed, darkness, kTimeoutMs, launch, look, open as openIn, overflow, reachedByTab} from './browser.mjs';
import {Runs, sceneText} from './runs.mjs';

const kToken = 'correct-horse-battery';
const kMotions = [40, 40, -80].map((x) => `    - {translation_mm: [${x}, 0, 0], rotation_deg: [0, 0, 0]}\n`).join('');

const runs = new Runs(process.env.FRINGESLAM_PROGRAM, process.env.FRINGESLAM_SOURCE_DIR, resolve('scene'));
const running = new Set();
let browser, scene, served;

async function serve(...words) {
  const child = spawn(runs.program, ['scene', 'open', scene, '--port', '0', ...words], {stdio: ['ignore', 'ignore', 'pipe']});
  running.add(child);
  let said = '';
  const ended = new Promise((done) => child.on('exit', (code) => {
    running.delete(child);
    done(code);
  }));
  const url = await new Promise((done, failed) => {
    child.stderr.on('data', (bytes) => {
      said += bytes;
      const [, address] = said.match(/scene: (\S+)\n/) ?? [];
      if (address) done(address);
    });
    child.on('exit', () => failed(new Error(said)));
  });
  return {
    url, port: new URL(url).port,
    stop(signal) {
      child.kill(signal);
      return ended;
    },
  };
}

const status = (port, path, headers = {}) => new Promise((done, failed) => {
  request({host: '127.0.0.1', port, path, headers}, (answer) => {
    answer.resume();
    done(answer.statusCode);
  }).on('error', failed).end();
});

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
  for (const child of running) child.kill('SIGKILL');
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

test('a page of another origin, another host name and a viewer without token are refused', async () => {
  assert.equal(await status(served.port, '/scene'), 200);
  assert.equal(await status(served.port, '/scene', {Host: 'evil.example'}), 403);
  assert.equal(await status(served.port, '/scene', {Origin: 'http://evil.example'}), 403);
  assert.equal(await status(served.port, '/mesh/99999'), 404);
  const open_to_all = await serve('--live-host', '0.0.0.0', '--live-token', kToken);
  for (const path of ['/scene', '/mesh/0']) {
    assert.equal(await status(open_to_all.port, path), 401, path);
    assert.equal(await status(open_to_all.port, path, {Authorization: `Bearer ${kToken}`}), 200, path);
  }
  const {page, close} = await open(`http://127.0.0.1:${open_to_all.port}/#token=${kToken}`);
  assert.ok((await look(page, '.stage')).colours > 50);
  await close();
  await open_to_all.stop('SIGTERM');
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
  for (const id of ['theme', 'scene', 'time', 'reset']) assert.ok(reached.has(id), `${id}: ${[...reached]}`);
  await close();
});

test('it follows the system to the dark, and fits a phone', async () => {
  const {page, close} = await open(served.url, {colorScheme: 'dark', viewport: {width: 360, height: 740}, isMobile: true, hasTouch: true});
  assert.ok((await darkness(page)) < 150);
  assert.ok((await overflow(page)) <= 0, 'the page is wider than the phone');
  await close();
});
