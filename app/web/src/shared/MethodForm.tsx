/** Chooses how a drive is computed: method, its options, the way to positions and its options, all by the API's schema. */
import { useEffect, useId, useState } from "preact/hooks";
import type { components } from "../api/schema";
import { errorText } from "./Messages";
import { type MethodChosen, type Methods, methods } from "./methods";
import { type Chosen, type Schema, SchemaFields } from "./SchemaFields";
import { t } from "./texts";
import "./forms.css";

type Choice = components["schemas"]["Choice"];

interface PartProps {
  label: string;
  choices: Choice[];
  usual: string;
  name: string;
  options: Chosen;
  choose: (name: string, options: Chosen) => void;
  needs?: string[] | undefined;
}

function Part({ label, choices, usual, name, options, choose, needs }: PartProps) {
  const id = useId();
  const shown = choices.find((one) => one.name === (name || usual));
  const schema = (shown?.options ?? {}) as Schema;
  const count = Object.keys(schema.properties ?? {}).length;
  return (
    <section class="part">
      <label for={id}>{label}</label>
      <select
        id={id}
        value={name}
        aria-describedby={`${id}-help`}
        onChange={(event) => choose(event.currentTarget.value, {})}
      >
        <option value="">{t("upload.usual", { value: usual })}</option>
        {choices.map((one) => (
          <option key={one.name} value={one.name}>
            {one.name} – {one.title}
          </option>
        ))}
      </select>
      <p id={`${id}-help`} class="quiet-text">
        {shown?.description} {needs?.length ? t("upload.needs", { what: needs.join("; ") }) : ""}{" "}
        {t("upload.source", { source: shown?.source ?? "" })}
      </p>
      {count > 0 && (
        <details>
          <summary>{t("upload.options", { n: count, changed: Object.keys(options).length })}</summary>
          <SchemaFields schema={schema} chosen={options} choose={(values) => choose(name, values)} />
        </details>
      )}
    </section>
  );
}

interface FormProps {
  chosen: MethodChosen;
  choose: (chosen: MethodChosen) => void;
  /** Told once what there is to choose. */
  known?: (known: Methods) => void;
}

/** The form; asks the service what there is when it is first shown. */
export function MethodForm({ chosen, choose, known }: FormProps) {
  const [all, setAll] = useState<Methods | null>(null);
  const [problem, setProblem] = useState<unknown>(null);
  useEffect(() => {
    methods().then((all) => {
      setAll(all);
      known?.(all);
    }, setProblem);
  }, []);
  if (problem !== null)
    return (
      <p class="error-text" role="alert">
        {errorText(problem)}
      </p>
    );
  if (all === null) return <p class="quiet-text">{t("upload.loading")}</p>;
  const method = all.methods.find((one) => one.name === (chosen.method || all.default));
  return (
    <div class="method-form">
      <Part
        label={t("upload.method")}
        choices={all.methods}
        usual={all.default}
        name={chosen.method}
        options={chosen.options}
        needs={method?.needs}
        choose={(name, options) => choose({ ...chosen, method: name, options })}
      />
      <Part
        label={t("upload.positions")}
        choices={all.positionings}
        usual={all.default_positioning}
        name={chosen.gnss}
        options={chosen.gnssOptions}
        choose={(name, gnssOptions) => choose({ ...chosen, gnss: name, gnssOptions })}
      />
    </div>
  );
}
