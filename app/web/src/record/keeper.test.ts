import { expect, test } from "vitest";
import { NOTHING } from "./figures";
import { type Chunk, Keeper, type Recording, type Shelf } from "./keeper";
import { fixesOf, motionsOf } from "./log";
import type { Fix } from "./samples";

/** A shelf in memory that fails when it is told to. */
class Memory implements Shelf {
  recordings = new Map<string, Recording>();
  kept: Chunk[] = [];
  full = false;

  async all() {
    return [...this.recordings.values()];
  }
  async put(recording: Recording, chunk?: Chunk) {
    await Promise.resolve();
    if (this.full) throw new Error("full");
    this.recordings.set(recording.id, recording);
    if (chunk !== undefined) this.kept[recording.chunks - 1] = chunk;
  }
  async chunks() {
    return this.kept;
  }
  async remove(id: string) {
    this.recordings.delete(id);
  }
}

const fresh: Recording = {
  id: "a",
  began_ms: 0,
  altitudes: "ellipsoid",
  sealed: false,
  chunks: 0,
  totals: NOTHING,
};
const fix = (time_ms: number): Fix => ({
  time_ms,
  lat_deg: 49,
  lon_deg: 8.4,
  altitude_m: 100,
  h_acc_m: 5,
  v_acc_m: 8,
  speed_mps: 10,
  course_deg: 90,
});
const motion = { time_ms: 7, force_x: 1, force_y: 2, force_z: 3, rate_x: 4, rate_y: 5, rate_z: 6 };
const totals = { ...NOTHING, positions: 2, ran_ms: 5000 };
const timesOf = (shelf: Memory) => [...fixesOf(shelf.kept)].map((one) => one.time_ms);

test("each chunk holds what came since the one before, and the list knows how much it is", async () => {
  const shelf = new Memory();
  const keeper = new Keeper(shelf, fresh);
  keeper.addFix(fix(1));
  keeper.addMotion(motion);
  await keeper.keep(totals);
  keeper.addFix(fix(2));
  await keeper.keep(totals);
  await keeper.keep(totals);
  expect(shelf.kept).toHaveLength(2);
  expect(timesOf(shelf)).toEqual([1, 2]);
  expect([...motionsOf(shelf.kept)]).toEqual([motion]);
  const [listed] = await shelf.all();
  expect(listed).toMatchObject({ chunks: 2, totals: { positions: 2, ran_ms: 5000, motions: 1 } });
  expect(listed?.totals.bytes).toBe(8 * (2 * 8 + 7));
});

test("who has got nothing has recorded nothing", async () => {
  const shelf = new Memory();
  await new Keeper(shelf, fresh).keep(totals);
  expect(await shelf.all()).toEqual([]);
});

test("what could not be kept goes with the next chunk, once", async () => {
  const shelf = new Memory();
  const keeper = new Keeper(shelf, fresh);
  keeper.addFix(fix(1));
  shelf.full = true;
  await expect(keeper.keep(totals)).rejects.toThrow("full");
  keeper.addFix(fix(2));
  shelf.full = false;
  const both = [keeper.keep(totals), keeper.keep(totals)];
  keeper.addFix(fix(3));
  await Promise.all(both);
  await keeper.keep(totals);
  expect(timesOf(shelf)).toEqual([1, 2, 3]);
});

test("a recording that goes on keeps what it had", async () => {
  const shelf = new Memory();
  const before = new Keeper(shelf, fresh);
  before.addFix(fix(1));
  await before.keep(totals);
  const [listed] = await shelf.all();
  const after = new Keeper(shelf, listed as Recording);
  after.addFix(fix(2));
  await after.keep({ ...totals, positions: 3 });
  expect(timesOf(shelf)).toEqual([1, 2]);
  expect((await shelf.all())[0]?.totals.bytes).toBe(2 * 64);
});
