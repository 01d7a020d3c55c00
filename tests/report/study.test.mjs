// SPDX-License-Identifier: Apache-2.0
// A study's page in a browser; environment as in report.test.mjs.
import assert from 'node:assert/strict';
import {readFileSync} from 'node:fs';
import {resolve} from 'node:path';
import {after, before, test} from 'node:test';
import {changed, darkness, kTimeoutMs, launch, look, open as openIn, overflow, reachedByTab} from './browser.mjs';
import {kWildName} from './runs.mjs';
import {kTrials, Studies} from './studies.mjs';

const studies = new Studies(process.env.FRINGESLAM_PROGRAM, process.env.FRINGESLAM_SOURCE_DIR, resolve('studies'));
let browser, many;
const open = (options, file = many) => openIn(browser, file, options);

before(async () => {
  many = studies.many('many', 3);
  browser = await launch();
}, {timeout: 3 * kTimeoutMs});
after(() => browser?.close());

const summary = () => JSON.parse(readFileSync(studies.at('many', 'out', 'summary.json')));
const dataOf = (page) => page.evaluate(() => JSON.parse(document.getElementById('data').textContent));
const chosen = async (page) => Number((await page.locator('#trial-name').textContent()).match(/^Trial (\d+):/)[1]);
const isPhone = {viewport: {width: 360, height: 740}, hasTouch: true, isMobile: true, deviceScaleFactor: 2};

async function assertNothingStrange(page) {
  assert.doesNotMatch(await page.locator('body > :not(script)').allInnerTexts().then((texts) => texts.join('\n')), /NaN|undefined|null|Infinity/);
}

async function unfold(page) {
  await page.evaluate(() => document.querySelectorAll('details').forEach((details) => (details.open = true)));
  await page.waitForFunction(() => document.querySelectorAll('.folded:not(:has(table))').length === 0);
}

test('the head shows name, rate, interval and what is missing', async () => {
  const {page, close} = await open();
  assert.equal(await page.locator('#name').textContent(), kWildName);
  assert.equal(await page.title(), `${kWildName} · FringeSLAM`);
  assert.equal(await page.locator('#hurt').count(), 0);
  const {successes, success_95: interval} = summary();
  const head = (await page.locator('#figures').innerText()).replaceAll('\u00a0', ' ');
  assert.match(head, new RegExp(`${((100 * successes) / kTrials).toFixed(1)} %`));
  assert.match(head, new RegExp(`${successes} of ${kTrials}; 95 % interval ${interval.map((end) => `${(100 * end).toFixed(1)} %`).join(' to ')}`));
  assert.match(await page.locator('#missing').innerText(), /2 trials of 124 are missing/);
  await assertNothingStrange(page);
  await close();
});

test('different ticks have different labels', async () => {
  const shared = (name) => import(resolve(studies.source, 'tools/report/page/src/shared', name));
  const [{linear}, {tickText}] = [await shared('axes.js'), await shared('chart.js')];
  const labels = (from) => linear(from, [0, 100]).ticks(4).map(tickText);
  assert.deepEqual(labels([0.985, 1]), ['0.985', '0.99', '0.995', '1']);
  assert.deepEqual(labels([1000, 1006]), ['1000', '1002', '1004', '1006']);
  assert.deepEqual(labels([-2, 2]), ['−2', '−1', '0', '1', '2']);
});

test('each chart shows its data', async () => {
  const {page, close} = await open();
  const charts = await page.locator('.chart').count();
  assert.equal(charts, 3 + 2 + 2 + 1);
  const before = [];
  for (let i = 0; i < charts; ++i) before.push(await look(page, `.chart >> nth=${i}`));
  const points = await look(page, '#points');
  await page.addStyleTag({content: '.band, .rate, .rate-dot, .whisker, .curve, .share, .safe, .whole, .marker-dot, .mark { visibility: hidden }'});
  for (let i = 0; i < charts; ++i) {
    assert.ok(before[i].colours > 20, `chart ${i} has only ${before[i].colours} colours`);
    assert.notEqual((await look(page, `.chart >> nth=${i}`)).hash, before[i].hash, `chart ${i} is empty`);
  }
  assert.notEqual((await look(page, '#points')).hash, points.hash, 'the scatter is empty');
  assert.match(await page.locator('#envelope').innerText(), /of \d+ trials within these ranges succeed/);
  await close();
});

test('causes are counted, explained and pick their trials out', async () => {
  const {page, close} = await open();
  const {causes} = summary();
  const shown = await page.locator('#causes').innerText();
  for (const [cause, count] of Object.entries(causes)) {
    assert.match(shown, new RegExp(`${cause.replaceAll('_', ' ')}[^]*?${count}\\s`), cause);
  }
  const {trials} = await dataOf(page);
  const all = await look(page, '#points');
  await page.locator('[data-cause=too_dark]').click();
  await changed(page, '#points', all);
  assert.ok((await page.locator('.mark.pale').count()) > 0);
  await page.keyboard.press('Tab');
  await page.locator('#points').focus();
  for (const key of ['Home', 'ArrowRight', 'ArrowUp', 'End', 'ArrowDown']) {
    await page.keyboard.press(key);
    assert.equal(trials.causes[trials.cause[trials.trial.indexOf(await chosen(page))]], 'too_dark', key);
  }
  await close();
});

test('the keys, the pointer and the number choose a trial; its command is shown', async () => {
  const {page, close} = await open();
  const {trials, parameters} = await dataOf(page);
  const across = parameters.findIndex(({name}) => name === 'decode.min_modulation_dn');
  await page.getByLabel('y axis', {exact: true}).selectOption('translation error, mm');
  await page.getByLabel('x axis', {exact: true}).selectOption('decode.min_modulation_dn');
  // The trials with an error, ordered by their modulation.
  const order = trials.trial.filter((_, i) => trials.translation_mm[i] !== null)
    .sort((a, b) => trials.values[across][a] - trials.values[across][b]);
  await page.locator('#points').focus();
  await page.keyboard.press('Home');
  assert.equal(await chosen(page), order[0]);
  for (const trial of order.slice(1, 5)) {
    await page.keyboard.press('ArrowRight');
    assert.equal(await chosen(page), trial);
  }
  assert.match(await page.locator('#trial code').textContent(), new RegExp(`^fringeslam study replay '.*study.yaml' --trial ${order[4]}$`));
  const ring = await page.locator('.ring').boundingBox();
  await page.keyboard.press('End');
  assert.equal(await chosen(page), order.at(-1));
  await page.mouse.click(ring.x + ring.width / 2, ring.y + ring.height / 2);
  assert.equal(await chosen(page), order[4]);
  await page.getByLabel('trial', {exact: true}).fill('23');
  await page.keyboard.press('Enter');
  assert.equal(await chosen(page), 23);
  await page.locator('#trial .command button').click();
  await page.locator('#trial .command button:text-matches("Copied|Selected")').waitFor();
  await close();
});

test('the worst trials have their pictures, or say why not', async () => {
  const {page, close} = await open();
  assert.equal(await page.locator('.worst-card').count(), 3);
  for (const trial of [7, 11]) {
    const seen = await look(page, `#trial-${trial} canvas >> nth=0`);
    assert.ok(seen.colours > 50, `only ${seen.colours} colours`);
    assert.ok((await look(page, `#trial-${trial} img >> nth=0`)).colours > 50);
  }
  assert.match(await page.locator('#trial-13').innerText(), /timed out in the study and was not run again/);
  assert.match(await page.locator('#trial-11 code').textContent(), /^fringeslam run .*--out runs\/trial-11$/);
  await page.locator('#trial-11 .chooser').click();
  assert.equal(await chosen(page), 11);
  await page.locator('#trial a').click();
  assert.match(page.url(), /#trial-11$/);
  await close();
});

test('the tables say what the charts show', async () => {
  const {page, close} = await open();
  await unfold(page);
  const first = summary().parameters[0].classes[0];
  const row = await page.locator('#tables tbody tr').first().innerText();
  assert.match(row, new RegExp(`\\t${first.trials}\\t${((100 * first.successes) / first.trials).toFixed(1)}\\s%`));
  assert.equal(await page.locator('.folded').last().locator('tbody tr').count(), kTrials);
  await assertNothingStrange(page);
  await close();
});

test('all that can be operated is reached by Tab and shows its focus', async () => {
  const {page, close} = await open();
  const reached = await reachedByTab(page, 80);
  for (const name of ['skip', 'theme', 'points', 'chooser', 'SELECT', 'number', 'SUMMARY']) assert.ok(reached.has(name), name);
  await close();
});

test('it follows the system to the dark, and the button back', async () => {
  const {page, close} = await open({colorScheme: 'dark'});
  assert.ok((await darkness(page)) < 150);
  const [chart, points] = [await look(page, '.chart >> nth=0'), await look(page, '#points')];
  await page.locator('#theme').click();
  assert.ok((await darkness(page)) > 600);
  await changed(page, '.chart >> nth=0', chart);
  await changed(page, '#points', points);
  await close();
});

test('it fits a phone, unfolded as well', async () => {
  for (const colorScheme of ['light', 'dark']) {
    const {page, close} = await open({...isPhone, colorScheme});
    assert.ok((await overflow(page)) <= 0, 'the page is wider than the phone');
    await unfold(page);
    assert.ok((await overflow(page)) <= 0, 'unfolded, the page is wider than the phone');
    for (const id of ['#points', '#trial', '#parameters', '#tables']) {
      const box = await page.locator(id).boundingBox();
      assert.ok(box.x >= 0 && box.x + box.width <= 360, `${id} sticks out`);
    }
    const before = await chosen(page);
    await page.locator('#points').tap();
    assert.notEqual(await chosen(page), before);
    await close();
  }
});

test('a study without a failure, and one of a single trial that was lost', async () => {
  const well = await open({}, studies.allWell('well'));
  assert.match(await well.page.locator('#causes').innerText(), /No trial failed/);
  assert.match(await well.page.locator('#worst').innerText(), /No trial failed/);
  await unfold(well.page);
  await assertNothingStrange(well.page);
  await well.close();

  const file = studies.oneLost('lost');
  const lost = await open({}, file);
  assert.match(await lost.page.locator('#errors').innerText(), /No trial has a measurable motion/);
  assert.equal(await chosen(lost.page), 0);
  assert.match(await lost.page.locator('#worst').innerText(), /--worst N/);
  await unfold(lost.page);
  await assertNothingStrange(lost.page);
  await lost.close();
  // Without pictures the page is small: it contains no 3D code.
  const page = readFileSync(file, 'utf8');
  assert.ok(page.length < 100_000, `${page.length} bytes`);
  assert.doesNotMatch(page, /WebGL/);
});
