// SPDX-License-Identifier: Apache-2.0
// node picture.mjs PAGE.html OUT.png [WIDTHxHEIGHT [light|dark]]: a page as a picture, from its top on.
import {resolve} from 'node:path';
import {launch, open} from './browser.mjs';

const [, , file, out, size = '1280x1600', colorScheme = 'light'] = process.argv;
const [width, height] = size.split('x').map(Number);
const browser = await launch();
const {page, close} = await open(browser, resolve(file), {viewport: {width, height}, colorScheme});
await page.screenshot({path: out});
await close();
await browser.close();
