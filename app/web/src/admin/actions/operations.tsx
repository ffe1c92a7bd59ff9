/** Things of the operator that take long: asked for, shown as a plan, approved or dropped. */
import { confirmed } from "../../shared/Confirm";
import { tellDone, tellError } from "../../shared/Messages";
import { t } from "../../shared/texts";
import { withQuery } from "../links";
import { reader } from "../page_state";
import { ask } from "../requests";
import type { Operation } from "../types";

export const OPERATIONS = "/v1/operations";

/** Something of the operations changed. */
export function operationsChanged(): void {
  reader.readNow(OPERATIONS, "/v1/admin/attention", "/v1/admin/audit");
}

/** An operation ended: roads and elevation may be others. */
export function groundChanged(): void {
  reader.readNow("/v1/regions", "/v1/rasters", "/v1/admin/attention", "/v1/admin/device-classes");
}

const WIDENINGS = { "learn-widenings": "learn", "reset-widenings": "reset" } as const;

/** Ask for an operation without a file. */
export async function askFor(kind: string, name: string | null): Promise<void> {
  try {
    await ask<Operation>("POST", withQuery(OPERATIONS, { kind, name }));
    const asked = kind === "settle" ? "settle_asked" : kind in WIDENINGS ? "widenings_asked" : "plan_asked";
    tellDone(t(`admin.operations.${asked}`));
    operationsChanged();
  } catch (error) {
    tellError(error);
  }
}

/** Ask, then solve the whole map anew. */
export async function settle(): Promise<void> {
  const yes = await confirmed({
    title: t("admin.settle.ask"),
    what: <p>{t("admin.settle.what")}</p>,
    action: t("admin.settle.do"),
  });
  if (yes) await askFor("settle", null);
}

/** Ask, then learn widenings of device classes, or reset them. */
export async function widen(kind: keyof typeof WIDENINGS): Promise<void> {
  const name = WIDENINGS[kind];
  const yes = await confirmed({
    title: t(`admin.repeats.${name}_ask`),
    what: <p>{t(`admin.repeats.${name}_what`)}</p>,
    action: t(`admin.repeats.${name}_do`),
  });
  if (yes) await askFor(kind, null);
}

/** Whether what it takes away is not brought back by asking for it again. */
export function destroys(one: Operation): boolean {
  return one.kind.startsWith("remove");
}

/** Carry out what is planned: the plan itself is the question, but for a removal, which is asked for once more. */
export async function approve(one: Operation): Promise<void> {
  if (
    destroys(one) &&
    !(await confirmed({
      title: t("admin.operations.approve_ask", { what: one.subject ?? one.kind }),
      what: <p>{t("admin.operations.approve_what")}</p>,
      action: t("admin.operations.approve"),
      destructive: true,
    }))
  )
    return;
  try {
    await ask<Operation>("POST", `${OPERATIONS}/${one.id}/approve`);
    tellDone(t("admin.operations.approved"));
    operationsChanged();
  } catch (error) {
    tellError(error);
  }
}

/** Drop what is planned, or cancel what waits: nothing of it has been done. */
export async function drop(one: Operation): Promise<void> {
  try {
    await ask<unknown>("DELETE", `${OPERATIONS}/${one.id}`);
    tellDone(t("admin.operations.dropped"));
    operationsChanged();
  } catch (error) {
    tellError(error);
  }
}
