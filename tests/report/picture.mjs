// SPDX-License-Identifier: Apache-2.0
// node picture.mjs PAGE.html|http://… OUT.png [WIDTHxHEIGHT [light|dark]]: renders the top of a page to a picture;
// waits on a live page until a view and the map are shown, and on a scene's page until the world and the full image are.
import {resolve} from 'node:path';
import {launch, open} from './browser.mjs';

const [, , file, out, size = '1280x1600', colorScheme = 'light'] = process.argv;
const [width, height] = size.split('x').map(Number);
const browser = await launch();
const live = file.startsWith('http:');
const {page, close} = await open(browser, live ? file : resolve(file), {viewport: {width, height}, colorScheme});
if (live) {
  await page.waitForSelector('#pictures[data-view], #sensor-picture[data-shown$="full"]', {timeout: 120_000});
  await page.waitForSelector('#scene[data-whole]', {state: 'attached'});
}
await page.screenshot({path: out});
await close();
await browser.close();
