// SPDX-License-Identifier: Apache-2.0
// Opens pages in a headless browser.
import assert from 'node:assert/strict';
import {existsSync} from 'node:fs';
import {pathToFileURL} from 'node:url';
import {chromium} from 'playwright-core';

export const kTimeoutMs = 60000;  // generous for slow machines; tests never wait for it to pass
const kBrowser = process.env.CHROMIUM ?? '/usr/bin/chromium';
const kFlags = [
  '--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
  '--disable-component-update', '--disable-sync', '--use-gl=angle', '--use-angle=swiftshader',
  '--enable-unsafe-swiftshader',
];

export function launch() {
  assert.ok(existsSync(kBrowser), `${kBrowser} is missing: run tools/setup --test, or set CHROMIUM`);
  return chromium.launch({executablePath: kBrowser, args: kFlags, timeout: kTimeoutMs});
}

// Opens a page from a file or address, waits until it is drawn, and checks that it requested nothing from other origins
// than `others` and reported no errors except `expected` ones.
export async function open(browser, place, {expected = /^$/, others = /^$/, ...options} = {}) {
  const context = await browser.newContext({viewport: {width: 1280, height: 900}, reducedMotion: 'reduce', ...options});
  const served = place.startsWith('http:');
  const home = served ? place : pathToFileURL(place).href;
  const isHome = (url) => (served ? url.startsWith(`${new URL(home).origin}/`) : url === home);
  const page = await context.newPage();
  page.setDefaultTimeout(kTimeoutMs);
  const troubles = [];
  page.on('console', (message) => message.type() === 'error' && !expected.test(message.text()) && troubles.push(`console: ${message.text()}`));
  page.on('pageerror', (error) => troubles.push(`error: ${error}`));
  await page.route('**/*', (route) => {
    const url = route.request().url();
    if (/^(data|blob):/.test(url) || isHome(url) || others.test(url)) return route.continue();
    troubles.push(`request: ${url}`);
    return route.abort();
  });
  await page.goto(home);
  await page.waitForSelector('html[data-ready]');
  return {page, async close() {
    assert.deepEqual(troubles, []);
    await context.close();
  }};
}

// The pixels of an element as shown: bytes r g b a r g b a …
export const screenPixels = async (page, selector) => decoded(page, await page.locator(selector).screenshot());

// The same, one number per pixel.
export const screenColours = async (page, selector) => new Uint32Array((await screenPixels(page, selector)).buffer);

// The pixels of a PNG, decoded by the page.
export async function decoded(page, png) {
  const bytes = await page.evaluate(async (data) => {
    const image = new Image();
    image.src = `data:image/png;base64,${data}`;
    await image.decode();
    const context = new OffscreenCanvas(image.width, image.height).getContext('2d');
    context.drawImage(image, 0, 0);
    const pixels = new Blob([context.getImageData(0, 0, image.width, image.height).data]);
    const url = await new Promise((done) => {
      const reader = new FileReader();
      reader.onload = () => done(reader.result);
      reader.readAsDataURL(pixels);
    });
    return url.slice(url.indexOf(',') + 1);
  }, png.toString('base64'));
  return Uint8Array.from(Buffer.from(bytes, 'base64'));
}

// Describes an element's appearance: its number of colours, and a hash of its pixels.
export async function look(page, selector) {
  const pixels = await screenColours(page, selector);
  let hash = 0;
  for (const pixel of pixels) hash = (Math.imul(hash, 31) + pixel) | 0;
  return {colours: new Set(pixels).size, hash};
}

// Waits until an element's appearance has changed.
export async function changed(page, selector, before) {
  const end = Date.now() + kTimeoutMs;
  for (;;) {
    const now = await look(page, selector);
    if (now.hash !== before.hash) return now;
    assert.ok(Date.now() < end, `${selector} did not change`);
  }
}

export const darkness = (page) => page.evaluate(() => {
  const [red, green, blue] = getComputedStyle(document.body).backgroundColor.match(/\d+/g).map(Number);
  return red + green + blue;
});
export const overflow = (page) => page.evaluate(() => document.documentElement.scrollWidth - innerWidth);

// Returns what up to `most` presses of Tab reach, by id, class or tag, and checks that each shows its focus.
export async function reachedByTab(page, most) {
  const reached = new Set();
  for (let i = 0; i < most; ++i) {
    await page.keyboard.press('Tab');
    const [name, outline] = await page.evaluate(() => {
      const at = document.activeElement;
      return at === document.body ? [null] : [at.id || at.className || at.tagName, getComputedStyle(at).outlineStyle];
    });
    if (name === null) break;
    reached.add(name);
    assert.notEqual(outline, 'none', `${name} shows no focus`);
  }
  return reached;
}
