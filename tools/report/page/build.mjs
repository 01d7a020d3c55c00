// SPDX-License-Identifier: Apache-2.0
// node build.mjs, beside node_modules: NAME_page.html, the page without data, and NAME_page.cpp, the same as a C++
// source, of each page of src/.
import {readFileSync, writeFileSync} from 'node:fs';
import {build} from 'esbuild';

// folder: in src/; packages: those in its bundle; skip: where the first link leads; title and data: where the program puts
// in none; connects: to the server that it is from, else nothing is fetched.
const kPages = [
  {name: 'report', folder: 'run', packages: ['three', 'uplot'], skip: {id: 'pictures', name: 'views'}},
  {name: 'study', folder: 'study', packages: [], skip: {id: 'scatter', name: 'trials'}},
  {name: 'live', folder: 'live', packages: ['three'], skip: {id: 'pictures', name: 'pictures'}, connects: true, title: 'Live', data: '{}'},
];

async function bundled(entry, options) {
  const result = await build({
    entryPoints: [entry],
    bundle: true,
    minify: true,
    charset: 'utf8',
    target: ['chrome100', 'firefox113', 'safari16.4'],
    legalComments: 'inline',
    write: false,
    logLevel: 'warning',
    ...options,
  });
  return result.outputFiles[0].text;
}

function escaped(text) {
  return text.replaceAll('&', '&amp;').replaceAll('<', '&lt;').replaceAll('>', '&gt;');
}

function licencesOf(packages) {
  if (packages.length === 0) return '';
  const licences = packages.map((name) => {
    const {version} = JSON.parse(readFileSync(`node_modules/${name}/package.json`));
    return `${name} ${version}\n\n${readFileSync(`node_modules/${name}/LICENSE`, 'utf8').trim()}`;
  });
  return `<details>
    <summary>Licences of what this page is made with</summary>
    <pre>${escaped(licences.join('\n\n\n'))}</pre>
  </details>`;
}

async function pageOf({folder, packages, skip, connects, title, data}) {
  const script = await bundled(`src/${folder}/main.js`, {format: 'iife'});
  const style = await bundled(`src/${folder}/style.css`, {});
  if (script.includes('</script') || style.includes('</style')) throw new Error('the bundle would end its own element');
  // Functions, because texts may hold what replace() takes for patterns.
  return readFileSync('template.html', 'utf8')
    .replace('@@CONNECTS@@', () => (connects ? "connect-src 'self'; " : ''))
    .replace('@@TITLE@@', (place) => title ?? place)
    .replace('@@DATA@@', (place) => data ?? place)
    .replace('@@STYLE@@', () => style.trim())
    .replace('@@SKIP_ID@@', () => skip.id)
    .replace('@@SKIP_NAME@@', () => skip.name)
    .replace('@@BODY@@', () => readFileSync(`src/${folder}/body.html`, 'utf8').trim())
    .replace('@@LICENCES@@', () => licencesOf(packages))
    .replace('@@SCRIPT@@', () => script.trim());
}

function sourceOf(name, page) {
  const delimiter = 'FRINGESLAM';
  if (page.includes(`)${delimiter}"`)) throw new Error('the page holds the delimiter of its own string');
  // Compilers limit the length of one literal; neighbours become one.
  const pieces = page.match(/[^]{1,8000}/g).map((piece) => `R"${delimiter}(${piece})${delimiter}"`);
  return `// Made by tools/report/page/build.mjs.
#include "tools/report/report_page.h"

namespace fringeslam::tools {

std::string_view ${name}_page() {
  return
${pieces.join('\n')};
}

}  // namespace fringeslam::tools
`;
}

for (const entry of kPages) {
  const page = await pageOf(entry);
  writeFileSync(`${entry.name}_page.html`, page);
  writeFileSync(`${entry.name}_page.cpp`, sourceOf(entry.name, page));
}
