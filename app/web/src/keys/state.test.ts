import { expect, it, vi } from "vitest";

vi.stubGlobal("location", new URL("http://127.0.0.1/keys"));
vi.stubGlobal("document", { querySelector: () => null });
const { inOrder, stateOf } = await import("./state");
type Key = Parameters<typeof inOrder>[0][number];

const NOW = Date.parse("2026-03-01T12:00:00Z");
const key = (id: string, expires_at: string | null = null, revoked_at: string | null = null) =>
  ({ id, expires_at, revoked_at }) as Key;

it.each([
  [key("a"), "active"],
  [key("a", "2026-03-01T12:00:01Z"), "active"],
  [key("a", "2026-03-01T12:00:00Z"), "expired"],
  [key("a", null, "2026-02-01T00:00:00Z"), "revoked"],
  [key("a", "2026-02-01T00:00:00Z", "2026-01-01T00:00:00Z"), "revoked"],
])("%j is %s", (one, state) => expect(stateOf(one, NOW)).toBe(state));

it("lists what opens something first, else as it came", () => {
  const past = "2026-01-01T00:00:00Z";
  const all = [key("gone", null, past), key("late", past), key("b"), key("a", "2027-01-01T00:00:00Z")];
  expect(inOrder(all, NOW).map((one) => one.id)).toEqual(["b", "a", "late", "gone"]);
});
