import { beforeEach, expect, it, vi } from "vitest";

const place = new URL("http://127.0.0.1/map?at=1/2/3&segment=17#there");
vi.stubGlobal("location", Object.assign(place, { assign: vi.fn() }));
vi.stubGlobal("document", { querySelector: () => null });

const { config } = await import("./config");
const { askSession, isNobody, loginAddress, lookAgain, may } = await import("./session");
const assign = (location as unknown as { assign: ReturnType<typeof vi.fn> }).assign;
const HERE = "/login?return_to=%2Fmap%3Fat%3D1%2F2%2F3%26segment%3D17%23there";

function answer(access: string, scope: string | null): void {
  vi.stubGlobal("fetch", async () => Response.json({ access, scope, public_map: "live" }));
}

beforeEach(() => {
  assign.mockClear();
  config.login_url = null;
});

it("tries everything and leads nowhere before anything is known", async () => {
  vi.stubGlobal("fetch", async () => new Response("", { status: 502 }));
  await askSession();
  expect([isNobody(), may("operate"), loginAddress()]).toEqual([false, true, null]);
});

it.each([
  ["open", null, [true, true, true], false],
  ["keys", null, [false, false, false], true],
  ["keys", "upload", [true, false, false], false],
  ["keys", "own", [true, true, false], false],
  ["keys", "operate", [true, true, true], false],
] as const)("with access %s and scope %s it may %j", async (access, scope, allowed, nobody) => {
  answer(access, scope);
  await askSession();
  expect((["upload", "own", "operate"] as const).map(may)).toEqual(allowed);
  expect(isNobody()).toBe(nobody);
  expect(loginAddress()).toBe(access === "open" ? null : HERE);
});

it("lets a login in front of the service go first", async () => {
  answer("keys", null);
  await askSession();
  config.login_url = "/sso?app=1";
  const login = new URL(loginAddress() ?? "");
  expect([login.pathname, login.searchParams.get("return_to")]).toEqual(["/sso", location.href]);
});

it("goes to log in where a session is over, and not where there was none", async () => {
  answer("keys", "own");
  await askSession();
  await lookAgain();
  expect(assign).not.toHaveBeenCalled();
  answer("keys", null);
  await lookAgain();
  expect(assign).toHaveBeenCalledExactlyOnceWith(HERE);
  await lookAgain();
  expect(assign).toHaveBeenCalledTimes(1);
});
