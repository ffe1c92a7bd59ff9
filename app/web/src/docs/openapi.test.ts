import { expect, test } from "vitest";
import {
  type ApiDocument,
  addressOf,
  boundsOf,
  curlOf,
  exampleOf,
  groupsOf,
  matching,
  type Operation,
  typeOf,
} from "./openapi";

const responses = { 200: { description: "Done." } };
const document: ApiDocument = {
  openapi: "3.1.0",
  info: { title: "Test", version: "1" },
  tags: [{ name: "drives", description: "Logs." }, { name: "empty" }],
  paths: {
    "/": { get: { responses } },
    "/v1/drives/{drive_id}": {
      get: {
        tags: ["drives"],
        summary: "One drive",
        responses,
        parameters: [
          { name: "drive_id", in: "path", required: true, schema: { type: "string", examples: ["a/b"] } },
          { name: "bbox", in: "query", explode: false, schema: { type: "array", items: { type: "number" } } },
          { name: "option", in: "query", schema: { type: "array", items: { type: "string" } } },
        ],
      },
      patch: {
        tags: ["drives"],
        summary: "Change",
        responses,
        requestBody: { content: { "application/json": { schema: { $ref: "#/components/schemas/Change" } } } },
      },
    },
  },
  components: {
    schemas: {
      Change: {
        type: "object",
        properties: {
          name: { type: "string", examples: ["it's"] },
          next: { anyOf: [{ $ref: "#/components/schemas/Change" }, { type: "null" }] },
          list: { type: "array", items: { type: "integer" } },
        },
      },
    },
  },
};
const groups = groupsOf(document);
const [read, change] = (groups[0]?.operations ?? []) as [Operation, Operation];

test("operations stand in the groups that the document names, others after them", () => {
  expect(groups.map((group) => [group.tag, group.operations.map((one) => one.id)])).toEqual([
    ["drives", ["get-v1-drives-drive_id", "patch-v1-drives-drive_id"]],
    ["other", ["get-root"]],
  ]);
});

test("every word must be found, wherever", () => {
  expect(matching(groups, ["one", "bbox"]).flatMap((group) => group.operations)).toEqual([read]);
  expect(matching(groups, ["nothing"])).toEqual([]);
  expect(matching(groups, [])).toBe(groups);
});

test("a type is named, with what it may also be", () => {
  expect(typeOf({ anyOf: [{ type: "string", format: "uuid" }, { type: "null" }] }, document)).toBe(
    "string (uuid) | null",
  );
  expect(typeOf({ anyOf: [{ type: "number" }, { type: "string" }] }, document)).toBe("number | string");
  expect(typeOf({ type: "array", items: { $ref: "#/components/schemas/Change" } }, document)).toBe(
    "Change[]",
  );
  expect(boundsOf({ minimum: 0, exclusiveMaximum: 4 })).toEqual(["≥ 0", "< 4"]);
  expect(boundsOf({ minimum: 1, maximum: 2 ** 63 })).toEqual(["≥ 1"]);
});

test("an example of what refers to itself has an end", () => {
  const example = exampleOf({ $ref: "#/components/schemas/Change" }, document) as { next: { name: string } };
  expect(example.next.name).toBe("it's");
});

test("an address has what is given, as the parameter wants it", () => {
  expect(addressOf(read, { drive_id: "a/b", bbox: "1,2", option: "x:1,y:2" })).toBe(
    "/v1/drives/a%2Fb?bbox=1%2C2&option=x%3A1&option=y%3A2",
  );
  expect(addressOf(read, { drive_id: "1" })).toBe("/v1/drives/1");
});

test("a line for a shell stays one, whatever an example holds", () => {
  expect(curlOf(read, "http://here", document)).toBe("curl 'http://here/v1/drives/a%2Fb'");
  expect(curlOf(change, "http://here", document)).toContain("it'\\''s");
});
