import { readdirSync } from "node:fs";
import { resolve } from "node:path";
import { defineConfig } from "vite";
import { manifest } from "./plugins/manifest.ts";

const here = import.meta.dirname;
const repository = resolve(here, "../..");
const pages = readdirSync(resolve(here, "src")).filter((name) => name.endsWith(".html"));

// What is built is shipped with the package (app/web/pages.py serves it under /web/): no source maps, no other host.
export default defineConfig({
  root: resolve(here, "src"),
  base: "/web/",
  cacheDir: resolve(here, "node_modules/.vite"),
  publicDir: resolve(here, "src/public"),
  plugins: [manifest(repository)],
  build: {
    outDir: resolve(here, "built"),
    emptyOutDir: true,
    assetsDir: "assets",
    target: "es2022",
    modulePreload: { polyfill: false },
    license: { fileName: "licenses.md" },
    chunkSizeWarningLimit: 1500,
    rolldownOptions: { input: pages.map((name) => resolve(here, "src", name)) },
  },
  worker: { format: "es" },
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
  server: {
    fs: { allow: [repository] },
    proxy: Object.fromEntries(
      [
        "/v1",
        "/tiles",
        "/style.json",
        "/sprites",
        "/glyphs",
        "/collections",
        "/openapi.json",
        "/docs/contents.json",
      ].map((path) => [path, "http://127.0.0.1:8000"]),
    ),
  },
});
