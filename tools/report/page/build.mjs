// SPDX-License-Identifier: Apache-2.0
// node build.mjs OUT.html OUT.cpp, beside node_modules: the page without data, and the same as a C++ source.
import {readFileSync, writeFileSync} from 'node:fs';
import {build} from 'esbuild';

const [, , htmlFile, sourceFile] = process.argv;

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

const script = await bundled('src/main.js', {format: 'iife'});
const style = await bundled('src/style.css', {});
if (script.includes('</script') || style.includes('</style')) throw new Error('the bundle would end its own element');

const licences = ['three', 'uplot'].map((name) => {
  const {version} = JSON.parse(readFileSync(`node_modules/${name}/package.json`));
  return `${name} ${version}\n\n${readFileSync(`node_modules/${name}/LICENSE`, 'utf8').trim()}`;
});

// Functions, because texts may hold what replace() takes for patterns.
const page = readFileSync('template.html', 'utf8')
  .replace('@@STYLE@@', () => style.trim())
  .replace('@@LICENCES@@', () => escaped(licences.join('\n\n\n')))
  .replace('@@SCRIPT@@', () => script.trim());
writeFileSync(htmlFile, page);

const delimiter = 'FRINGESLAM';
if (page.includes(`)${delimiter}"`)) throw new Error('the page holds the delimiter of its own string');
// Compilers limit the length of one literal; neighbours become one.
const pieces = page.match(/[^]{1,8000}/g).map((piece) => `R"${delimiter}(${piece})${delimiter}"`);
writeFileSync(sourceFile, `// Made by tools/report/page/build.mjs.
#include "tools/report/report_page.h"

namespace fringeslam::tools {

std::string_view report_page() {
  return
${pieces.join('\n')};
}

}  // namespace fringeslam::tools
`);
