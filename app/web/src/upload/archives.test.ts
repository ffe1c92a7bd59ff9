import { deflateRawSync } from "node:zlib";
import { describe, expect, it } from "vitest";
import { inRuns, isArchive, listFor, listIn, MOST_OF_A_RUN } from "./archives";
import { filesIn, type Packed } from "./zip";

/** A zip as other programs make it; sizes stand in the table alone. */
function zipped(files: Record<string, string | Uint8Array>, deflate = true): Uint8Array {
  const parts: Uint8Array[] = [];
  const table: Uint8Array[] = [];
  let at = 0;
  for (const [name, content] of Object.entries(files)) {
    const data = typeof content === "string" ? new TextEncoder().encode(content) : content;
    const body = deflate ? new Uint8Array(deflateRawSync(data)) : data;
    const path = new TextEncoder().encode(name);
    const local = new DataView(new ArrayBuffer(30));
    local.setUint32(0, 0x04034b50, true);
    local.setUint16(26, path.length, true);
    const entry = new DataView(new ArrayBuffer(46));
    entry.setUint32(0, 0x02014b50, true);
    entry.setUint16(10, deflate ? 8 : 0, true);
    entry.setUint32(20, body.length, true);
    entry.setUint32(24, data.length, true);
    entry.setUint16(28, path.length, true);
    entry.setUint32(42, at, true);
    parts.push(new Uint8Array(local.buffer), path, body);
    table.push(new Uint8Array(entry.buffer), path);
    at += 30 + path.length + body.length;
  }
  const end = new DataView(new ArrayBuffer(22));
  end.setUint32(0, 0x06054b50, true);
  end.setUint32(
    12,
    table.reduce((sum, one) => sum + one.length, 0),
    true,
  );
  end.setUint32(16, at, true);
  const all = [...parts, ...table, new Uint8Array(end.buffer)];
  return new Uint8Array(all.flatMap((one) => [...one]));
}

const zip = (files: Record<string, string | Uint8Array>, deflate = true) =>
  new File([zipped(files, deflate) as BlobPart], "rides.zip");
const named = (path: string, size = 10): Packed => ({
  name: path.split("/").pop() ?? "",
  path,
  size,
  lastModified: 0,
  open: () => Promise.resolve(new File(["x"], path)),
});

describe("a zip", () => {
  it("gives the files in it, and in zips in it", async () => {
    const inner = zipped({ "a.fit": "inner", "folder/": "" });
    for (const deflate of [true, false]) {
      const found = await filesIn(zip({ "b.gpx": "outer", "DI/Part1.zip": inner, "z.zip": "none" }, deflate));
      expect(found.map((file) => [file.path, file.size])).toEqual([
        ["DI/Part1.zip/a.fit", 5],
        ["b.gpx", 5],
        ["z.zip", 4],
      ]);
      expect(await (await (found[0] as Packed).open()).text()).toBe("inner");
      expect((await (found[1] as Packed).open()).name).toBe("b.gpx");
    }
  });

  it("that is none says so, and one that unpacks to more than it says stops", async () => {
    await expect(filesIn(new File(["hello"], "x.zip"))).rejects.toThrow("no zip");
    const bytes = zipped({ "a.csv": "many bytes ".repeat(1000) });
    new DataView(bytes.buffer).setUint32(bytes.length - 22 - 46 - 5 + 24, 7, true);
    const [bomb] = await filesIn(new File([bytes as BlobPart], "x.zip"));
    await expect((bomb as Packed).open()).rejects.toThrow("larger than it says");
  });
});

describe("an archive", () => {
  it("is more than one upload takes", () => {
    const many = Array.from({ length: MOST_OF_A_RUN + 1 }, (_, k) => named(`${k}.gpx`));
    expect(isArchive(many, "x.zip")).toBe(true);
    expect(isArchive(many.slice(1), "x.zip")).toBe(false);
    expect(isArchive([named("a.zip/b.fit")], "x.zip")).toBe(true);
    expect(isArchive([named("a.gpx"), named("b.gpx")], "export_12345.zip")).toBe(true);
  });

  it("is sent in runs of one folder, without pictures, lists and hidden files", () => {
    const rides = Array.from({ length: 40 }, (_, k) => named(`activities/${100 + k}.gpx`));
    const more = ["activities.csv", "media/1.jpg", ".hidden/x.gpx", "other/a.fit"].map((path) => named(path));
    const { runs, others } = inRuns([...rides, ...more, named("other/b.fit", 2 ** 27)]);
    expect(runs.map((run) => run.length)).toEqual([31, 9, 1, 1]);
    expect(others.map((file) => file.name)).toEqual(["1.jpg"]);
  });

  it("tells of each run what the list says of it", async () => {
    const list = 'id,type,file\n1,Ride,activities/1.gpx\n2,"Swim, far",activities/2.gpx\n';
    const file = { ...named("e/activities.csv"), open: () => Promise.resolve(new File([list], "a")) };
    expect(await listIn([named("e/1.gpx"), file])).toBe(list);
    expect(await listIn([named("e/1.gpx")])).toBe("");
    const told = listFor([named("e/activities/2.gpx")], list);
    expect(await told?.text()).toBe('id,type,file\n2,"Swim, far",activities/2.gpx\n');
    expect(listFor([named("e/activities/3.gpx")], list)).toBeNull();
  });
});
