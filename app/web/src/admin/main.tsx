import { Page, show } from "../shared/Page";

function Content() {
  return (
    <Page name="admin">
      <h1>admin</h1>
    </Page>
  );
}

await show("admin", Content);
