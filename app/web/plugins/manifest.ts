/**
 * Writes `sources.json` beside what is built: SHA-256 of each source and of each built file. A test in Python compares
 * both with what is there (tests/app/web/test_built.py), so that nothing built is old or edited by hand.
 *
 * Sources are what the build reads: the pages, and how they are built. The types of the API are none (they leave nothing
 * behind), nor are tests.
 */
import { createHash } from "node:crypto";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { join, relative, resolve } from "node:path";
import type { Plugin } from "vite";

export const MANIFEST = "sources.json";
const FOLDERS = ["app/web/src", "app/web/plugins"];
const CATALOGUES = ["fusion/catalogues", "app/core/messages"].flatMap((folder) =>
  ["en", "de"].map((language) => `${folder}/${language}.json`),
);
const FILES = ["package.json", "package-lock.json", "tsconfig.json", "vite.config.ts"].map(
  (name) => `app/web/${name}`,
);
const NO_SOURCE = /(^app\/web\/src\/api\/|\/node_modules\/|\.test\.tsx?$)/;

function below(folder: string): string[] {
  return readdirSync(folder, { recursive: true, withFileTypes: true })
    .filter((entry) => entry.isFile())
    .map((entry) => join(entry.parentPath, entry.name));
}

function digests(paths: string[], root: string): Record<string, string> {
  const named = paths.map((path) => relative(root, path).replaceAll("\\", "/")).sort();
  return Object.fromEntries(
    named.map((name) => [
      name,
      createHash("sha256")
        .update(readFileSync(join(root, name)))
        .digest("hex"),
    ]),
  );
}

/** The plugin; `repository` is the root that names of sources begin at. */
export function manifest(repository: string): Plugin {
  let folder = "";
  return {
    name: "manifest",
    apply: "build",
    configResolved(config) {
      folder = resolve(config.root, config.build.outDir);
    },
    closeBundle() {
      const sources = [
        ...FOLDERS.flatMap((name) => below(join(repository, name))),
        ...[...FILES, ...CATALOGUES].map((name) => join(repository, name)),
      ];
      const kept = sources.filter((path) => !NO_SOURCE.test(relative(repository, path)));
      const told = { sources: digests(kept, repository), built: digests(below(folder), folder) };
      writeFileSync(join(folder, MANIFEST), `${JSON.stringify(told, null, 1)}\n`);
    },
  };
}
