/** What the service answers to operators, as this page reads it. */
import type { Said } from "../shared/said";

export interface Answer<Row> {
  name: string;
  title: string;
  as_of: string;
  rows: Row[];
}

export interface QueryList {
  queries: { name: string; title: string; description: string; kept: boolean }[];
}

export interface Attention {
  kind: string;
  severity: "act" | "look";
  count: number;
  oldest_s: number | null;
  what: string;
  said?: Said | null;
  link: string | null;
}

export interface Waiting {
  kind: string;
  jobs: number;
  oldest_s: number | null;
}

export interface Failure {
  kind: string | null;
  drives: number;
  share: number | null;
  latest_reason: string | null;
  latest_said?: Said | null;
  latest_at: string | null;
  latest_drive: string | null;
  /** Of these, drives that wait for roads: no failures to people. */
  waiting?: number;
}

export interface DayOfDrives {
  day: string;
  status: string;
  drives: number;
  km: number;
  uploaded_bytes: number;
  /** Of those that failed: how many wait for roads. */
  waiting?: number;
}

export interface Times {
  method: string;
  drives: number;
  waited_p50_s: number | null;
  waited_p95_s: number | null;
  computed_p50_s: number | null;
  computed_p95_s: number | null;
  published_p50_s: number | null;
  published_p95_s: number | null;
  computed_p50_s_per_km: number | null;
}

export interface Coverage {
  region: string;
  highway: string;
  segments: number;
  network_km: number;
  driven_segments: number;
  driven_km: number;
}

export interface SigmaCount {
  drives_from: number;
  sigma_from_percent: number;
  segments: number;
  km: number;
}

export interface Disagreement {
  segment_id: number;
  osm_way_id: number;
  highway: string;
  name: string | null;
  slope_percent: number | null;
  slope_sigma_percent: number | null;
  drives: number;
  drives_rejected: number;
  lowest_percent: number | null;
  highest_percent: number | null;
  farthest_sigmas: number | null;
}

export interface Repeat {
  kind: "all" | "class" | "direction" | "speed" | "length" | "season";
  group: string;
  pairs: number;
  drive_pairs: number;
  segments: number;
  rms_z: number;
  rms_z_sigma: number | null;
  inside_share: number;
  median_difference_percent: number;
  mean_sigma_percent: number;
  widening: number | null;
}

export interface DeviceClass {
  name: string;
  applied: number;
  learned: number;
  sigma: number;
  pairs: number;
  drive_pairs: number;
  drives: number;
  learned_at: string;
  marking: boolean;
}

export interface TerrainTile {
  tile: string;
  segments: number;
  km: number;
  mean_difference_percent: number;
  rms_difference_percent: number;
  rms_sigma_percent: number;
}

export interface Stored {
  kind: string;
  name: string;
  rows_about: number;
  table_bytes: number;
  index_bytes: number;
}

export type Bounds = [number, number, number, number];

export interface Region {
  name: string;
  source_name: string | null;
  imported_at: string | null;
  segments: number;
  measured: number | null;
  bbox: Bounds | null;
}

export interface Raster {
  name: string;
  /** Whose data it is, and its licence; null: nobody said. */
  source?: string | null;
  licence?: string | null;
  priority: number;
  resolution_m?: number | null;
  resolution_deg?: number | null;
  bbox: Bounds | null;
  imported_at: string | null;
  with_quality: boolean;
}

export type OperationStatus = "queued" | "running" | "planned" | "done" | "failed" | "cancelled";

export interface Operation {
  id: string;
  kind: string;
  subject: string | null;
  status: OperationStatus;
  progress: number;
  stage: string | null;
  plan: Record<string, unknown> | null;
  result: Record<string, unknown> | null;
  failure: { kind: string; reason: string; said?: Said | null } | null;
  created_at: string;
  started_at: string | null;
  finished_at: string | null;
}

export interface Link {
  href: string;
  rel: string;
}

export interface BatchAccepted {
  queued: number;
  complete: boolean;
  method: string | null;
  skipped: Record<string, number>;
  note: string | null;
  note_said?: Said | null;
  links: Link[];
}

export interface Batch {
  state: "enqueuing" | "running" | "done" | "cancelled";
  asked_at: string | null;
  method: string | null;
  selection: Record<string, unknown> | null;
  drives: number;
  queued: number;
  running: number;
  done: number;
  failed: number;
  progress: number;
}

export interface Removal {
  drives: number;
  km: number;
  uploaded_bytes: number;
}

/** Per hour or day; what is missing is left out of its chart. */
export interface Throughput {
  at: string;
  done: number;
  failed: number;
  waiting?: number;
  km: number | null;
  waited_p50_s: number | null;
  computed_p50_s: number | null;
  published_p50_s: number | null;
}

export interface Growth {
  day: string;
  highway: string;
  driven_km: number;
}

export interface Tiles {
  zoom: number;
  tiles: number;
  bytes: number;
  stale: number;
}

export interface Audited {
  at: string;
  action: string;
  subject: string | null;
  detail: Record<string, unknown> | null;
  origin: string | null;
}

export interface UnsolvedCell {
  cell: string;
  bbox: Bounds;
  solvers: number;
  since: string;
  next_at: string;
  drives: string[];
  advice: string;
}
