import { expect, test, vi } from "vitest";

vi.mock("../shared/api", () => ({
  ApiProblem: class extends Error {
    constructor(readonly status: number) {
      super(`status ${status}`);
    }
  },
}));

const { Reader } = await import("./reading");
const { ApiProblem } = await import("../shared/api");

function problem(status: number): Error {
  return new (ApiProblem as unknown as new (status: number) => Error)(status);
}

function reader(answer: (address: string) => unknown) {
  const asked: string[] = [];
  const clock = { ms: 1_000_000 };
  const reading = new Reader(
    async (address) => {
      asked.push(address);
      return answer(address);
    },
    () => clock.ms,
  );
  return { reading, asked, clock };
}

test("what is watched is read when it is due, and only while somebody looks", async () => {
  const { reading, asked, clock } = reader((address) => address);
  const one = reading.watch("/a", 10);
  await reading.look();
  await reading.look();
  expect(asked).toEqual(["/a"]);
  expect(one.data.value).toBe("/a");
  clock.ms += 10_000;
  await reading.look();
  reading.unwatch("/a");
  clock.ms += 10_000;
  await reading.look();
  expect(asked).toHaveLength(2);
});

test("a service that answers 503 is asked ever more rarely, then as before", async () => {
  let busy = true;
  const { reading, asked, clock } = reader(() => {
    if (busy) throw problem(503);
    return 1;
  });
  for (const address of ["/a", "/b", "/c", "/d", "/e"]) reading.watch(address, 10);
  await reading.look();
  expect(asked.length).toBeLessThanOrEqual(3);
  const counts: number[] = [];
  for (let minute = 0; minute < 10; minute++) {
    const before = asked.length;
    for (let s = 0; s < 60; s++) {
      clock.ms += 1000;
      await reading.look();
    }
    counts.push(asked.length - before);
  }
  expect(counts[0]).toBeLessThanOrEqual(6);
  expect(counts.slice(-5).reduce((sum, n) => sum + n)).toBeLessThanOrEqual(6);
  busy = false;
  clock.ms += 300_000;
  await reading.look();
  expect(reading.restsUntil.value).toBeNull();
  clock.ms += 10_000;
  const before = asked.length;
  await reading.look();
  expect(asked.length - before).toBe(5);
});

test("what the service does not offer is not asked for again", async () => {
  const { reading, asked, clock } = reader(() => {
    throw problem(404);
  });
  const one = reading.watch("/a", 10);
  await reading.look();
  clock.ms += 60_000;
  await reading.look();
  expect(asked).toEqual(["/a"]);
  expect(one.missing.value).toBe(true);
});

test("a problem of one address is said there, and what was read stays", async () => {
  let broken = false;
  const { reading, clock } = reader(() => {
    if (broken) throw problem(500);
    return 7;
  });
  const one = reading.watch("/a", 10);
  await reading.look();
  broken = true;
  clock.ms += 10_000;
  await reading.look();
  expect([one.data.value, one.problem.value]).toEqual([7, "status 500"]);
  expect(reading.restsUntil.value).toBeNull();
});

test("pausing stops all but what is asked for by hand", async () => {
  const { reading, asked, clock } = reader(() => 1);
  reading.watch("/a", 10);
  reading.paused.value = true;
  await reading.look();
  expect(asked).toHaveLength(0);
  reading.readNow();
  clock.ms += 1;
  await vi.waitFor(() => expect(asked).toHaveLength(1));
});
