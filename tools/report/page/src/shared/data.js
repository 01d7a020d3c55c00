// SPDX-License-Identifier: Apache-2.0
// The data embedded in the page (tools/report/report_data.h describes it).
export const data = JSON.parse(document.getElementById('data').textContent);

// The inverse of packed() in tools/report/packing.h.
export async function unpacked(text, Values) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  const values = new Values(await new Response(stream).arrayBuffer());
  for (let i = 1; i < values.length; ++i) values[i] += values[i - 1];
  return values;
}
