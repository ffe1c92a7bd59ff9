/** The files in a zip that somebody chose, and in zips in it: nothing is unpacked before it is sent. */

/** A file in a zip, by the name that it has there. */
export interface Packed {
  name: string;
  path: string;
  size: number;
  lastModified: number;
  open: () => Promise<File>;
}

export type Sendable = File | Packed;

const END = 0x06054b50;
const END_64 = 0x06064b50;
const LOCATOR_64 = 0x07064b50;
const ENTRY = 0x02014b50;
const LOCAL_BYTES = 30;
const ENTRY_BYTES = 46;
/** A comment may stand behind the end. */
const MOST_TAIL_BYTES = 0xffff + 22;
const FULL = 0xffffffff;
const STORED = 0;
const DEFLATED = 8;
/** A zip in a zip in a zip. */
const MOST_DEPTH = 3;
export const MOST_FILES = 200_000;

/** The files of whatever is sent. */
export function opened(files: Sendable[]): Promise<File[]> {
  return Promise.all(files.map((file) => (file instanceof File ? file : file.open())));
}

/** Every file in a zip, by path; the promise fails where it is none that can be read. */
export async function filesIn(zip: File, before = "", depth = 1): Promise<Packed[]> {
  const found: Packed[] = [];
  for (const one of await entries(zip, before)) {
    if (!/\.zip$/i.test(one.name) || depth >= MOST_DEPTH) {
      found.push(one);
      continue;
    }
    try {
      found.push(...(await filesIn(await one.open(), `${one.path}/`, depth + 1)));
    } catch {
      found.push(one); // the service says what is wrong with it
    }
    if (found.length > MOST_FILES) throw new Error("too many files");
  }
  return found.sort((a, b) => (a.path < b.path ? -1 : 1));
}

async function view(file: Blob, start: number, end: number): Promise<DataView> {
  return new DataView(await file.slice(start, end).arrayBuffer());
}

/** Where the table of contents stands, and how long it is. */
async function directory(zip: Blob): Promise<[number, number]> {
  const at = Math.max(0, zip.size - MOST_TAIL_BYTES);
  const tail = await view(zip, at, zip.size);
  let end = tail.byteLength - 22;
  while (end >= 0 && tail.getUint32(end, true) !== END) end -= 1;
  if (end < 0) throw new Error("no zip");
  const [size, offset] = [tail.getUint32(end + 12, true), tail.getUint32(end + 16, true)];
  if (size !== FULL && offset !== FULL) return [offset, size];
  if (end < 20 || tail.getUint32(end - 20, true) !== LOCATOR_64) throw new Error("no zip");
  const place = Number(tail.getBigUint64(end - 12, true));
  const large = await view(zip, place, place + 56);
  if (large.getUint32(0, true) !== END_64) throw new Error("no zip");
  return [Number(large.getBigUint64(48, true)), Number(large.getBigUint64(40, true))];
}

async function entries(zip: Blob, before: string): Promise<Packed[]> {
  const [start, size] = await directory(zip);
  const table = await view(zip, start, start + size);
  const found: Packed[] = [];
  for (let at = 0; at + ENTRY_BYTES <= table.byteLength && table.getUint32(at, true) === ENTRY; ) {
    const lengths = [28, 30, 32].map((k) => table.getUint16(at + k, true)) as [number, number, number];
    const name = new TextDecoder().decode(new Uint8Array(table.buffer, at + ENTRY_BYTES, lengths[0]));
    const one = sizes(table, at, at + ENTRY_BYTES + lengths[0], lengths[1]);
    if (!name.endsWith("/") && one.size > 0) found.push(packed(zip, before + name, one));
    at += ENTRY_BYTES + lengths[0] + lengths[1] + lengths[2];
  }
  return found;
}

interface Sizes {
  method: number;
  locked: boolean;
  packed: number;
  size: number;
  offset: number;
}

/** What the table says of a file; of large ones in the field of zip64. */
function sizes(table: DataView, at: number, extra: number, extraBytes: number): Sizes {
  const plain = [24, 20, 42].map((k) => table.getUint32(at + k, true));
  for (let k = extra; k + 4 <= extra + extraBytes; k += 4 + table.getUint16(k + 2, true)) {
    if (table.getUint16(k, true) !== 1) continue;
    let next = k + 4;
    for (const [n, value] of plain.entries()) {
      if (value !== FULL) continue;
      plain[n] = Number(table.getBigUint64(next, true));
      next += 8;
    }
  }
  const [size, packedBytes, offset] = plain as [number, number, number];
  const locked = (table.getUint16(at + 8, true) & 1) === 1;
  return { method: table.getUint16(at + 10, true), locked, packed: packedBytes, size, offset };
}

function packed(zip: Blob, path: string, one: Sizes): Packed {
  const name = path.split("/").pop() ?? path;
  const open = async (): Promise<File> => {
    const local = await view(zip, one.offset, one.offset + LOCAL_BYTES);
    const start = one.offset + LOCAL_BYTES + local.getUint16(26, true) + local.getUint16(28, true);
    const data = zip.slice(start, start + one.packed);
    if (one.locked || (one.method !== STORED && one.method !== DEFLATED)) throw new Error("locked");
    return new File(one.method === STORED ? [data] : await inflated(data, one.size), name, {
      lastModified: 0,
    });
  };
  return { name, path, size: one.size, lastModified: 0, open };
}

/** What is deflated, up to the size that it says of itself: more is a bomb. */
async function inflated(data: Blob, size: number): Promise<BlobPart[]> {
  const reader = data.stream().pipeThrough(new DecompressionStream("deflate-raw")).getReader();
  const pieces: BlobPart[] = [];
  let bytes = 0;
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return pieces;
    bytes += value.byteLength;
    if (bytes > size) throw new Error("larger than it says");
    pieces.push(value);
  }
}
