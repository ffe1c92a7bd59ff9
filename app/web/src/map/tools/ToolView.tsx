/** The panel of a tool, loaded when it is opened. */
import type { ComponentType } from "preact";
import { useLoaded } from "../../segment/loading";
import { t } from "../../shared/texts";
import type { ToolName } from "../state";

const PARTS: Record<ToolName, () => Promise<{ default: ComponentType }>> = {
  steepest: () => import("./Steepest"),
  profile: () => import("./Profile"),
  export: () => import("./ExportView"),
  inclines: () => import("./Inclines"),
};

export function ToolView({ name }: { name: ToolName }) {
  const part = useLoaded(() => PARTS[name](), name);
  const Part = part.state === "there" ? part.value.default : null;
  return (
    <div class="tool">
      <h2>{t(`tools.${name}.title`)}</h2>
      {part.state === "failed" ? <p class="error-text">{part.why}</p> : Part && <Part />}
    </div>
  );
}
