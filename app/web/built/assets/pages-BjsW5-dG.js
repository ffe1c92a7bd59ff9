var e=`<h1 id="the-pages">The pages</h1>
<p><code>versant up</code> prints the address of the map. Nothing else is needed to look at what the service has: the pages are part of the package, load nothing from another host, and work without a network. They are in English and German, light and dark, for a desk and a phone, by keyboard and with a screen reader.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>page</th>
<th>for</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>/map</code></td>
<td>how steep roads are, how sure that is, and what is not known. A click on a road tells its slope, its profile and the drives behind it. The address holds all that is chosen: a link shows another person the same</td>
</tr>
<tr>
<td><code>/upload</code></td>
<td>logs by drag and drop, many at once; what became of each, and what to do where one failed</td>
</tr>
<tr>
<td><code>/drives</code></td>
<td>all drives, to be searched and sorted</td>
</tr>
<tr>
<td><code>/drives/{id}</code></td>
<td>one drive: its track beside its profile, what was matched, what contradicts others, other methods beside it, downloads</td>
</tr>
<tr>
<td><code>/admin</code></td>
<td>what needs a person first, then queue, throughput, what is measured, regions, elevation, tiles</td>
</tr>
<tr>
<td><code>/docs</code></td>
<td>these guides, and the API's description: search it, read what each route takes and answers, try what only reads</td>
</tr>
</tbody>
</table></div>
<p><code>/</code> in a browser leads to all of them. <code>/map?bbox=8.4,49.2,8.5,49.3</code>, <code>/map?segment=17</code> and <code>/map?way=3</code> open the map there, <code>/map?export=ID</code> shows the map that an export kept; <code>?lang=de</code> chooses a language once, the list in the header for good. What is shown is what the API answers: everything on a page can be had by a program, and <code>/openapi.json?f=html</code> tells the routes to browsers that run no scripts.</p>
<h2 id="settings"><a class="self" href="#settings">Settings</a></h2>
<ul>
<li><code>VERSANT_MAP_BACKGROUND_URL</code>: a MapLibre style, drawn below the roads. Browsers then ask its host, and no other, for that style, its tiles and its letters. Without it the roads stand on a plain ground.</li>
<li><code>VERSANT_LOGIN_URL</code>: there is no login yet, and the service listens on this machine only. Where something in front of it checks who asks, it may answer 401: pages then go to this address (a path of the same host, such as <code>/login</code>, or a whole one) with the address to come back to as <code>return_to</code>. Without it they say that they may not.</li>
</ul>
<h2 id="what-browsers-may-do"><a class="self" href="#what-browsers-may-do">What browsers may do</a></h2>
<p>Every page has a content security policy without <code>unsafe-inline</code>: scripts and styles are files of this service, connections go to this service (and to the host of the background). Names and notes that people upload are text on every page, never markup. The plain pages of <code>/collections</code> run nothing at all; the one style in them is named by its hash.</p>
<p>Whatever destroys something says beforehand what it will do, with figures, and asks.</p>
<h2 id="to-change-a-page"><a class="self" href="#to-change-a-page">To change a page</a></h2>
<p>Pages are written in TypeScript with Preact: <code>app/web/src/map.html</code> and <code>app/web/src/map/main.tsx</code> are one page, the others stand beside them, and what they share is in <code>app/web/src/shared/</code>. <code>app/web/pages.py</code> serves what is built.</p>
<pre tabindex="0"><code>make web        # npm's locked packages, types from the API, checks, tests, and the build into app/web/built
versant up      # the service, which serves what was built
cd app/web &amp;&amp; npm run dev    # or: pages that follow each change, at http://127.0.0.1:5173/web/map.html, asking the service on port 8000
</code></pre>
<p><code>app/web/built</code> is committed with its sources, so that nobody needs npm to install, run or test Versant. The build notes in <code>sources.json</code> what it read and what it wrote, and a test fails where either has changed since. These guides are built in as well: <strong>after a change of <code>.docs/</code> run <code>make web</code></strong>.</p>
<p>The types of requests and answers come from the API's own OpenAPI document: a page that asks for what there is no more does not compile. Texts stand in <code>app/web/src/texts/</code>, one file per language, never in a page.</p>
<h2 id="to-add-a-language"><a class="self" href="#to-add-a-language">To add a language</a></h2>
<ol>
<li>Copy <code>app/web/src/texts/en.json</code> to, say, <code>fr.json</code>, and translate the texts. <code>{names}</code> stay as they are; where a text has forms (<code>one</code>, <code>other</code>), give those that <code>Intl.PluralRules</code> names for the language.</li>
<li>In <code>app/web/src/shared/texts.ts</code> add it to <code>LANGUAGES</code>, and load it in <code>loadTexts</code> as German is.</li>
<li>In <code>tests/app/web/test_texts.py</code> and <code>app/web/src/shared/texts.test.ts</code> name its forms. Both tell what is missing.</li>
<li><code>make web</code>.</li>
</ol>
`;export{e as default};