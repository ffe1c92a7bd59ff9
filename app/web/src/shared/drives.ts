/** What several pages say of a drive in the same words. */
import type { components } from "../api/schema";
import { api, got } from "./api";
import { hasText, t } from "./texts";

/** A drive; the client's own type of a box is as wide. */
export type Drive = Omit<components["schemas"]["Drive"], "bbox"> & { bbox: number[] | null };

/** The drive as it is now. */
export function getDrive(id: string): Promise<Drive> {
  return got(api.GET("/v1/drives/{drive_id}", { params: { path: { drive_id: id } } }));
}

/** The map at a box of degrees: west, south, east, north. */
export function mapOf(bbox: readonly number[]): string {
  return `/map?bbox=${bbox.map((degrees) => degrees.toFixed(5)).join(",")}`;
}

/** What the worker is doing, in words. */
export function stageText(stage: string | null | undefined): string {
  const key = `upload.stage.${(stage ?? "begins").replaceAll(" ", "_")}`;
  if (hasText(key)) return t(key);
  // By which format a log is read is nothing to whoever waits.
  return stage?.startsWith("read ")
    ? t("upload.stage.reading")
    : t("upload.stage_other", { stage: stage ?? "" });
}
