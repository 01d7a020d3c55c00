// SPDX-License-Identifier: Apache-2.0
// node run_animation.mjs PROGRAM SOURCE OUT.gif OUT.png VIEWS [OPTION…]: animates the live page of `run SOURCE` with these options,
// which maps about VIEWS views, and draws the page when the last one is mapped.
import {mkdtempSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import gifenc from 'gifenc';
import {decoded, launch, open} from './browser.mjs';
import {serveProgram} from './served.mjs';

const [, , program, source, out, picture, views, ...options] = process.argv;
const kSize = {width: 1120, height: 680}, kFrames = 32, kFrameMs = 200, kLastMs = 4000;
const {GIFEncoder, quantize, applyPalette} = gifenc;

const folder = mkdtempSync(join(tmpdir(), 'fringeslam-run-'));
const served = await serveProgram(program, [
  'run', source, '--out', join(folder, 'run'), '--no-report', '--live', '0', '--live-wait', ...options,
], 'live');
const browser = await launch();
try {
  const {page, close} = await open(browser, served.url, {viewport: kSize});
  await page.waitForSelector('#scene[data-whole]', {state: 'attached'});
  const shown = () => page.evaluate(() => Number(document.querySelector('#pictures')?.dataset.view ?? -1));
  const finished = () => page.evaluate(() => document.querySelector('#connection').textContent === 'Finished');
  const gif = GIFEncoder();
  const step = Number(views) / kFrames;
  for (let next = 0, last = false; !last;) {
    last = await finished();
    const view = await shown();
    if (view >= next || last) {
      const pixels = await decoded(page, await page.screenshot());
      const palette = quantize(pixels, 256);
      gif.writeFrame(applyPalette(pixels, palette), kSize.width, kSize.height, {palette, delay: last ? kLastMs : kFrameMs});
      while (next <= view) next += step;
    } else {
      await new Promise((done) => setTimeout(done, 500));
    }
  }
  gif.finish();
  writeFileSync(out, gif.bytes());
  await page.screenshot({path: picture});
  await close();
} finally {
  await served.stop('SIGTERM');
  await browser.close();
  rmSync(folder, {recursive: true, force: true});
}
