/** Where the drive went, over the roads by slope; the place under the pointer is that of the charts' cursor. */
import { effect } from "@preact/signals";
import { type GeoJSONSource, type Map as LibreMap, Marker, type PaddingOptions } from "maplibre-gl";
import { useEffect, useRef, useState } from "preact/hooks";
import type { ChartLink } from "../shared/chart/lines";
import { makeMap } from "../shared/maplibre";
import { t } from "../shared/texts";
import { theme } from "../shared/theme";
import type { Profile } from "./data";
import { highlighted } from "./ride";
import { wantedBounds } from "./state";
import { type Kind, rowAt, rowNear } from "./stretches";
import { boundsOf, partLine, STRETCH, TRACK, trackLines, withTrack } from "./trackLayers";

/** Pixels around the track. */
const MARGIN_PX = 40;
/** Pixels from the track within which the pointer means it. */
const REACH_PX = 24;

type Bounds = [west: number, south: number, east: number, north: number];

interface Shown {
  profile: Profile;
  kinds: readonly Kind[];
  other: Profile | null;
}

/** Let the pointer on the map move the cursor of the charts, and the cursor a marker on the map. */
function linkUp(map: LibreMap, shown: () => Shown, link: ChartLink): () => void {
  const dot = document.createElement("div");
  dot.className = "track-marker";
  const marker = new Marker({ element: dot });
  let on = false;
  const end = effect(() => {
    const at = link.at.value;
    const { profile } = shown();
    const row = at === null ? -1 : rowAt(profile.distance_m, at);
    if (row < 0) {
      marker.remove();
      on = false;
      return;
    }
    marker.setLngLat([profile.lon_deg[row] as number, profile.lat_deg[row] as number]);
    if (!on) marker.addTo(map);
    on = true;
  });
  map.on("mousemove", (event) => {
    const { profile } = shown();
    const edge = map.unproject([event.point.x, event.point.y + REACH_PX]);
    const before = link.at.peek() === null ? null : rowAt(profile.distance_m, link.at.peek() as number);
    const reach = Math.abs(event.lngLat.lat - edge.lat);
    const row = rowNear(profile, event.lngLat.lng, event.lngLat.lat, reach, before);
    if (row !== null) link.at.value = profile.distance_m[row] as number;
  });
  return end;
}

/** Pixels to be left free on each side: below, those of the credit as well. */
function room(map: LibreMap, px: number): PaddingOptions {
  const credit = map.getContainer().querySelector<HTMLElement>(".maplibregl-ctrl-attrib")?.offsetHeight ?? 0;
  return { top: px, right: px, bottom: px + credit, left: px };
}

export function TrackMap({ profile, kinds, other, link }: Shown & { link: ChartLink }) {
  const place = useRef<HTMLDivElement>(null);
  const map = useRef<LibreMap | null>(null);
  const shown = useRef<Shown>({ profile, kinds, other });
  const [lacking, setLacking] = useState(false);
  shown.current = { profile, kinds, other };

  useEffect(() => {
    let over = false;
    const ends: (() => void)[] = [];
    const start = async () => {
      const { map: drawnMap, gone } = await makeMap({
        container: place.current as HTMLElement,
        bounds: boundsOf(shown.current.profile),
        fitBoundsOptions: { padding: MARGIN_PX, maxZoom: 17 },
        cooperativeGestures: matchMedia("(pointer: coarse)").matches,
        change: (style) => {
          const { profile, kinds, other } = shown.current;
          const second =
            other &&
            trackLines(
              other,
              other.segment_id.map(() => "matched"),
            );
          const part = partLine(profile, highlighted.peek());
          return withTrack(style, theme.peek(), trackLines(profile, kinds), second, part);
        },
        locale: {
          "NavigationControl.ZoomIn": t("drive.map.zoom_in"),
          "NavigationControl.ZoomOut": t("drive.map.zoom_out"),
          "AttributionControl.ToggleAttribution": t("drive.map.sources"),
          "Map.Title": t("drive.map.title"),
          "CooperativeGesturesHandler.WindowsHelpText": t("drive.map.gesture"),
          "CooperativeGesturesHandler.MacHelpText": t("drive.map.gesture"),
          "CooperativeGesturesHandler.MobileHelpText": t("drive.map.gesture"),
        },
      });
      if (over) return gone();
      map.current = drawnMap;
      const frame = (box: Bounds, maxPx: number) =>
        drawnMap.fitBounds(box, { padding: room(drawnMap, maxPx), maxZoom: 17, animate: false });
      // The credit is known when the tiles are: its height is left free then.
      drawnMap.once("idle", () => wantedBounds.peek() ?? frame(boundsOf(shown.current.profile), MARGIN_PX));
      ends.push(
        linkUp(drawnMap, () => shown.current, link),
        gone,
      );
      ends.push(
        effect(() => {
          const box = wantedBounds.value;
          if (box) frame(box, 60);
        }),
        effect(() => {
          const part = partLine(shown.current.profile, highlighted.value);
          drawnMap.getSource<GeoJSONSource>(STRETCH)?.setData(part);
        }),
      );
    };
    start().catch(() => setLacking(true));
    return () => {
      over = true;
      map.current = null;
      for (const end of ends) end();
    };
  }, [link, other]);

  useEffect(() => {
    const source = map.current?.getSource<GeoJSONSource>(TRACK);
    source?.setData(trackLines(profile, kinds));
  }, [profile, kinds]);

  return (
    <div class="track-map">
      <div ref={place} class="track-canvas" />
      {lacking && <p class="quiet-text">{t("drive.map.lacking")}</p>}
    </div>
  );
}
