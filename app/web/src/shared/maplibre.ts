/** Making a map: the one place that knows where MapLibre's worker is, which style the service has and how it follows the theme. */
import { effect } from "@preact/signals";
import {
  AttributionControl,
  Map as LibreMap,
  type MapOptions,
  NavigationControl,
  type StyleSpecification,
  setWorkerUrl,
} from "maplibre-gl";
import workerUrl from "maplibre-gl/dist/maplibre-gl-worker.mjs?url";
import "maplibre-gl/dist/maplibre-gl.css";
import "./maplibre.css";
import { getJson } from "./api";
import { creditInView } from "./credit";
import { ledToLogin } from "./session";
import { type Theme, theme } from "./theme";

setWorkerUrl(workerUrl);

/** Changes the service's style before it is drawn, and adds what is drawn over it. */
export type StyleChange = (style: StyleSpecification) => StyleSpecification;

/** The service's style for these colours. */
export function serviceStyle(colours: Theme): Promise<StyleSpecification> {
  return getJson<StyleSpecification>(`/style.json?theme=${colours}`);
}

interface Wishes extends Omit<MapOptions, "style"> {
  /** Is run for each style, also after a change of theme. */
  change?: StyleChange;
  /** Names of MapLibre's own controls in the visitor's language. */
  locale?: Record<string, string>;
}

/**
 * A map of the service's roads, which follows the theme. What it draws besides must come by `change`: a change of theme
 * replaces the style. `gone` removes it.
 */
export async function makeMap({ change = (style) => style, ...options }: Wishes): Promise<{
  map: LibreMap;
  gone: () => void;
}> {
  let shown = theme.peek();
  const map = new LibreMap({
    attributionControl: false,
    style: change(await serviceStyle(shown)),
    fadeDuration: matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 200,
    ...options,
  });
  map.on("error", ({ error }) => {
    if (!ledToLogin(error)) console.error(error);
  });
  map.addControl(new NavigationControl({ visualizePitch: false, showCompass: false }), "top-right");
  map.addControl(new AttributionControl({ compact: true }), "bottom-right");
  creditInView(map, "slopes");
  const end = effect(() => {
    const wanted = theme.value;
    if (wanted === shown) return;
    shown = wanted;
    void serviceStyle(wanted).then((style) => {
      if (shown === wanted) map.setStyle(change(style), { diff: false });
    });
  });
  return {
    map,
    gone: () => {
      end();
      map.remove();
    },
  };
}
