var e=`<h1 id="threats">Threats</h1>
<p>What somebody can try against a service, what happens, and what an operator has to see to. Every row is held by the test that it names; most were also tried on a service as <code>versant up</code> starts it. How a well-behaved client is served meanwhile is measured by <code>PYTHONPATH=.:benchmarks python -m hostile</code>, figures <a href="#under-attack">below</a>.</p>
<h2 id="who-is-promised-what"><a class="self" href="#who-is-promised-what">Who is promised what</a></h2>
<p>There is <strong>no access control yet</strong>: whoever reaches the API may do all that it can do, read every drive and remove it too. So the promises are about who reaches it, and about what a single request may cost.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>who</th>
<th>is promised</th>
</tr>
</thead>
<tbody>
<tr>
<td>whoever drove</td>
<td>a log, a track and a place leave the service by the API alone, never by a log line, a metric, an error or the map's tiles; after <code>DELETE</code> nobody is served any part of the drive</td>
</tr>
<tr>
<td>whoever runs the service on their own machine</td>
<td>only this machine reaches it; no page of another site reads or changes anything; no other user of the machine reads its files</td>
</tr>
<tr>
<td>whoever shares a service</td>
<td>one client cannot stop it for others: small inputs stay small work, and what is bounded says so in a problem document</td>
</tr>
<tr>
<td>whoever runs it for others</td>
<td>nothing that a request brings opens another file or address of the service's machine; every bound is a setting or stands on this page</td>
</tr>
</tbody>
</table></div>
<p><strong>Not promised</strong>: that clients who reach the API are kept apart (one may remove another's drives, take all <a href="/docs/changes">webhooks</a>, ask for settling again and again), that a flood of whole requests from many addresses is withstood, and anything against who may log in on the machine as the service's user, or as root.</p>
<h2 id="left-to-the-operator"><a class="self" href="#left-to-the-operator">Left to the operator</a></h2>
<ul>
<li><strong>Who reaches it.</strong> <code>VERSANT_HOST</code> other than loopback needs something in front that checks who asks: a reverse proxy with a login, a VPN, a firewall. <code>VERSANT_ALLOWED_HOSTS</code> and <code>VERSANT_PUBLIC_URL</code> name the hosts under which it answers.</li>
<li><strong>Floods.</strong> A proxy in front limits connections and requests for each address, buffers what clients send and take slowly, and ends TLS. The service limits its own work, not the network's.</li>
<li><strong>Disk and memory as a whole.</strong> <code>VERSANT_MIN_FREE_BYTES</code> keeps room free; a quota for each client is the proxy's or the operator's. A limit of the container or of systemd (<code>MemoryMax</code>) holds all processes together.</li>
<li><strong>A database server of your own</strong> has its own passwords, rights and backups: <code>VERSANT_DATABASE_URL</code> holds a password, so keep it in a file that only the service reads. Rights of folders named by <code>VERSANT_BLOB_URL</code> and <code>VERSANT_DEM_URL</code>, and of a data folder beside such a server, are as you made them.</li>
<li><strong>Backups</strong> hold everything, removed drives as well: keep them as you keep the logs.</li>
<li><strong>Files for spreadsheets.</strong> CSV holds names as OpenStreetMap and uploaders wrote them. A spreadsheet may take one that begins with <code>=</code> for a formula: import such columns as text.</li>
</ul>
<h2 id="what-is-tried-and-what-happens"><a class="self" href="#what-is-tried-and-what-happens">What is tried, and what happens</a></h2>
<p>Connections and requests (<a href="/docs/operation#clients">all bounds</a>):</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>tried</th>
<th>happens</th>
<th>bound or setting</th>
<th>held by</th>
</tr>
</thead>
<tbody>
<tr>
<td>a thousand sockets with half a request, silent ones, heads that drip</td>
<td>closed after the time; over the limit the longest silent one of whoever has most gives way, so probes and others get in</td>
<td><code>VERSANT_HEAD_TIMEOUT_S</code>, <code>VERSANT_CONNECTIONS_MAX</code>, <code>VERSANT_CONNECTIONS_PER_CLIENT</code></td>
<td><code>tests/app/core/receiving/test_connections.py</code></td>
</tr>
<tr>
<td>heads, header lines and trailers without end</td>
<td>431</td>
<td>32 KiB, 200 fields</td>
<td><code>tests/app/core/receiving/test_connections.py</code></td>
</tr>
<tr>
<td>bodies of which one byte comes</td>
<td>they are read before a place is taken; 408</td>
<td><code>VERSANT_BODY_TIMEOUT_S</code>, <code>VERSANT_UPLOAD_STALL_S</code></td>
<td><code>tests/app/core/receiving/test_pace.py</code></td>
</tr>
<tr>
<td>hundreds of slow searches by one client</td>
<td>two places of each lane are for clients that have none; one client fills half of the waiting room</td>
<td></td>
<td><code>tests/app/core/test_fair_lanes.py</code>, <code>tests/app/core/test_lanes.py</code></td>
</tr>
<tr>
<td>all event streams taken by one client</td>
<td>503 for more than its share</td>
<td><code>VERSANT_EVENTS_PER_CLIENT</code>, <code>VERSANT_EVENTS_MAX</code></td>
<td><code>tests/app/drives/test_events.py</code></td>
</tr>
<tr>
<td>thousands of requests on one connection, answers that nobody reads</td>
<td>closed</td>
<td>16 before the first answer, 60 s</td>
<td><code>tests/app/core/receiving/test_connections.py</code></td>
</tr>
<tr>
<td>a forged <code>X-Forwarded-For</code> in the audit log</td>
<td>believed from named proxies alone</td>
<td><code>VERSANT_TRUSTED_PROXIES</code></td>
<td><code>tests/app/core/receiving/test_clients.py</code></td>
</tr>
</tbody>
</table></div>
<p>Routes and files:</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>tried</th>
<th>happens</th>
<th>bound or setting</th>
<th>held by</th>
</tr>
</thead>
<tbody>
<tr>
<td>a web page of another site reads the map</td>
<td>browsers keep the answer from it: no CORS header</td>
<td><code>VERSANT_CORS_ORIGINS</code></td>
<td><code>tests/app/core/test_cors.py</code></td>
</tr>
<tr>
<td>a web page of another site changes something</td>
<td>403; browsers state where a page is from</td>
<td></td>
<td><code>tests/app/drives/test_upload.py</code></td>
</tr>
<tr>
<td>a host name is made to lead here after a page was loaded (DNS rebinding)</td>
<td>421</td>
<td><code>VERSANT_ALLOWED_HOSTS</code></td>
<td><code>tests/app/core/test_middleware.py</code></td>
</tr>
<tr>
<td>a webhook is to call this machine or a private network: by an old or embedding form of IPv6, a redirect, a name that changes</td>
<td>refused: only addresses that are given out to be reached from everywhere; the address that was checked is the one that is called, redirects are failures</td>
<td><code>VERSANT_WEBHOOK_PRIVATE</code></td>
<td><code>tests/app/changes/webhooks/test_sending.py</code></td>
</tr>
<tr>
<td>hundreds of webhooks</td>
<td>100 may be there, then 422</td>
<td></td>
<td><code>tests/app/changes/webhooks/test_webhooks.py</code></td>
</tr>
<tr>
<td>a filter that grows in SQL (<code>%</code> in <code>%</code>), nested brackets, long lists, many operators</td>
<td>400 that says the bound; what is written per operand is written once</td>
<td>64,000 characters, 32 deep, 250 operators, lists of 1,000, geometries of 5,000 points, SQL of 200,000 characters</td>
<td><code>tests/app/map/items/test_bounded_filters.py</code>, <code>tests/app/map/items/test_refused_filters.py</code>, <code>tests/fuzz/test_cql2.py</code></td>
</tr>
<tr>
<td>an expensive search</td>
<td>400 after the time; all statements of a page and their planning have it together</td>
<td><code>VERSANT_ITEMS_TIMEOUT_S</code>, <code>VERSANT_STATEMENT_TIMEOUT_S</code></td>
<td><code>tests/app/map/items/test_paging.py</code>, <code>tests/app/core/test_db.py</code></td>
</tr>
<tr>
<td>heights of very many places</td>
<td>422: 512 by <code>/v1/elevation</code>, 10,000 by <code>/height</code></td>
<td></td>
<td><code>tests/app/map/heights/test_heights.py</code></td>
</tr>
<tr>
<td>tiles and boxes that are none (NaN, infinite, beyond the Earth, numbers of 20 digits)</td>
<td>400 or 404</td>
<td></td>
<td><code>tests/app/map/test_tiles.py</code>, <code>tests/app/map/items/test_request.py</code></td>
</tr>
<tr>
<td>JSON nested 30,000 deep, numbers of 60,000 digits, NaN</td>
<td>400 or 422; a body that is no upload has 64 KiB</td>
<td></td>
<td><code>tests/app/core/test_middleware.py</code></td>
</tr>
<tr>
<td>an upload as 20,000 parts, with megabytes of headers, boundaries or other fields</td>
<td>422 at once</td>
<td>32 files of a drive; 64 KiB of other fields</td>
<td><code>tests/app/drives/test_parcel.py</code></td>
</tr>
<tr>
<td>paths in the names of files in a zip, absolute ones too</td>
<td>names only: nothing is unpacked to a disk by its name</td>
<td></td>
<td><code>tests/app/drives/test_bundles.py</code></td>
</tr>
<tr>
<td>a zip or gzip that unpacks to far more, zips in zips, 60,000 files</td>
<td>422 after a small part of it</td>
<td><code>VERSANT_MAX_LOG_BYTES</code></td>
<td><code>tests/fusion/formats/test_container.py</code>, <code>tests/app/core/test_content.py</code></td>
</tr>
<tr>
<td>XML entities that grow, external entities</td>
<td>the file is refused</td>
<td></td>
<td><code>tests/fusion/formats/test_gpx.py</code>, <code>tests/fusion/formats/test_tcx.py</code></td>
</tr>
<tr>
<td>hundreds of exports, trials, operations</td>
<td>100, 100 and 50 wait, 20 trials of a drive; then 503 or 409</td>
<td><code>VERSANT_EXPORTS_MAX_BYTES</code></td>
<td><code>tests/app/exports/test_exports.py</code>, <code>tests/app/operations/test_operations.py</code></td>
</tr>
<tr>
<td>the same drive asked for again 200 times, all drives 50 times</td>
<td>one job for each drive</td>
<td></td>
<td><code>tests/app/drives/batches/</code></td>
</tr>
<tr>
<td>hundreds of copies of one log that differ by a byte</td>
<td>each costs what the second one did; one of them is heard</td>
<td></td>
<td><code>tests/app/network/test_twins.py</code></td>
</tr>
<tr>
<td>an upload that fills the disk</td>
<td>507 before the room is gone</td>
<td><code>VERSANT_MIN_FREE_BYTES</code>, <code>VERSANT_MAX_UPLOAD_BYTES</code></td>
<td><code>tests/app/drives/test_upload.py</code></td>
</tr>
<tr>
<td>a log, a drive's name or an error with markup, read by a browser</td>
<td>text: errors are JSON, pages forbid every script but their own</td>
<td></td>
<td><code>tests/app/web/test_every_page.py</code>, <code>tests/app/drives/outputs/test_track_files.py</code></td>
</tr>
<tr>
<td>line breaks or control characters in a file's name, a path or <code>X-Request-ID</code></td>
<td>taken out of names, quoted in the log; such a number is replaced</td>
<td></td>
<td><code>tests/app/core/telemetry/test_requests.py</code>, <code>tests/app/core/telemetry/test_logs.py</code></td>
</tr>
<tr>
<td>places in log lines and metrics</td>
<td>blanked; labels are names of routes and methods</td>
<td></td>
<td><code>tests/app/core/telemetry/test_logs.py</code></td>
</tr>
<tr>
<td>a raster that names other files or addresses (VRT, overviews and headers beside it, grids of a reference system)</td>
<td>one driver, chosen by content: GeoTIFF, HGT, DTED; nothing else is opened. VRT and other formats for what the operator names on the command line</td>
<td></td>
<td><code>tests/fusion/terrain/test_drivers.py</code>, <code>tests/app/operations/test_hostile_files.py</code></td>
</tr>
<tr>
<td>a raster of 10 kB with 160,000,000,000 posts, blocks of gigabytes</td>
<td>refused by its header</td>
<td><code>VERSANT_MAX_RASTER_POSTS</code>; 64 MiB a block</td>
<td><code>tests/app/terrain/test_copying.py</code>, <code>tests/app/operations/test_hostile_files.py</code></td>
</tr>
<tr>
<td>a raster or a file of roads that unpacks to far more</td>
<td>refused, with room left on the disk</td>
<td><code>VERSANT_MAX_IMPORT_BYTES</code>, <code>VERSANT_MIN_FREE_BYTES</code>; an HGT its own size; 20 times for PBF, 50 for gzip</td>
<td><code>tests/app/terrain/test_copying.py</code>, <code>tests/fusion/roads/test_osm_bombs.py</code></td>
</tr>
<tr>
<td>imports by the dozen</td>
<td>50 wait or are planned, then 503; each lets drives go first between two pieces</td>
<td><code>VERSANT_IMPORTS_KEPT_BYTES</code></td>
<td><code>tests/app/operations/test_operations.py</code></td>
</tr>
<tr>
<td>a log of millions of rows</td>
<td>refused while it is read</td>
<td>500,000 positions</td>
<td><code>tests/fusion/formats/test_many_records.py</code></td>
</tr>
<tr>
<td>ten million particles</td>
<td>422; <code>versant fuse</code> may</td>
<td>a bound on each such option</td>
<td><code>tests/app/drives/test_modest_options.py</code></td>
</tr>
<tr>
<td>a drive that needs more memory than there is</td>
<td>it fails as <code>out-of-memory</code>, its lane and the other drives go on; what kills its process three times is given up</td>
<td><code>VERSANT_LANE_MEMORY_BYTES</code></td>
<td><code>tests/app/drives/test_worker.py</code></td>
</tr>
<tr>
<td>a removed drive is asked for while a trial of it runs</td>
<td>404 for every part from the answer to <code>DELETE</code> on; <a href="/docs/operation#removal">what stays</a></td>
<td></td>
<td><code>tests/app/drives/test_removed.py</code>, <code>tests/app/drives/test_remains.py</code></td>
</tr>
<tr>
<td>places and names of files in reasons of failures and in the audit log</td>
<td>blanked, left out</td>
<td>the latest 100,000 rows of audit</td>
<td><code>tests/app/ops/admin/test_audit.py</code></td>
</tr>
<tr>
<td>the power goes after an upload was answered</td>
<td>file and folder are synced before the answer</td>
<td></td>
<td><code>tests/app/core/test_durable.py</code></td>
</tr>
<tr>
<td>damaged files of every kind, every route with what it may and may not be asked</td>
<td>a sentence, within 5 s and a bound of memory; no 500</td>
<td><code>make fuzz</code> goes on as long as asked</td>
<td><code>tests/fuzz/</code></td>
</tr>
<tr>
<td>another user of the machine reads logs, rasters or the database</td>
<td>folders of a data folder with its own database are 0700; PostgreSQL listens on a socket in one of them, and on no port</td>
<td></td>
<td><code>tests/app/cli/test_database.py</code></td>
</tr>
</tbody>
</table></div>
<p>Tried and harmless: methods that do not exist, TRACE and CONNECT (405); ranges by the thousand (the whole file); <code>X-Forwarded-Host</code> (believed from nobody); headers of language and of types by the thousand; two lengths in one request (400); websockets (an ordinary answer); <code>Last-Event-ID</code> of 60,000 digits; <code>..</code> in paths of pages,
signs and letters (404); 300 uploads that stand still (others go on, their parts go with them); <code>LIKE</code> with 2,000 wildcards; drawings by size (the size is fixed); thinning by <code>points=</code> beyond its bounds (422).</p>
<p>Open: drives are computed in the order in which they came, so a client who uploads hundreds of small logs is in front of the next one for as long as they take; whoever reads an answer very slowly, but reads, holds it in memory; quick routes share forty threads in the order of asking; anybody who reaches the API may approve what another planned. Pages of other sites cannot read, but can tell by an embedded picture that a service is there. Owners and keys will close the first and the last but one.</p>
<h2 id="under-attack"><a class="self" href="#under-attack">Under attack</a></h2>
<p><code>PYTHONPATH=.:benchmarks python -m hostile</code> starts a service with the usual limits (1,024 files a process) and attacks it in eleven ways, one after the other and all at once, while a client uploads a drive every four seconds and asks for eight other things four times a second. Good is: the 99th percentile of every kind of request below 2 s,
nothing answered by 503 (or not at all) for more than 5 s, no drive lost. Every attack comes from a loopback address of its own; with <code>--same-address</code> all come from the client's.</p>
<p>With its bounds (<code>--seconds 15</code>, two cores, nothing else running; the worst kind of request, s; the largest process, MB), it says Good:</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>attack</th>
<th>p99</th>
<th>away for</th>
<th>drives</th>
<th>API</th>
<th>database</th>
<th>worker</th>
</tr>
</thead>
<tbody>
<tr>
<td>nothing</td>
<td>0.07</td>
<td>0</td>
<td>4 of 4</td>
<td>148</td>
<td>10</td>
<td>188</td>
</tr>
<tr>
<td>a filter whose operands double 17 times</td>
<td>0.06</td>
<td>0</td>
<td>4 of 4</td>
<td>150</td>
<td>11</td>
<td>188</td>
</tr>
<tr>
<td>40 bodies of which one byte comes</td>
<td>0.05</td>
<td>0</td>
<td>4 of 4</td>
<td>151</td>
<td>11</td>
<td>188</td>
</tr>
<tr>
<td>210 connections with slow filters</td>
<td>0.11</td>
<td>0</td>
<td>4 of 4</td>
<td>160</td>
<td>12</td>
<td>187</td>
</tr>
<tr>
<td>800 event streams</td>
<td>0.45</td>
<td>0</td>
<td>4 of 4</td>
<td>162</td>
<td>17</td>
<td>187</td>
</tr>
<tr>
<td>1,100 half requests</td>
<td>0.06</td>
<td>0</td>
<td>4 of 4</td>
<td>163</td>
<td>12</td>
<td>187</td>
</tr>
<tr>
<td>heads that never end</td>
<td>0.05</td>
<td>0</td>
<td>4 of 4</td>
<td>163</td>
<td>12</td>
<td>188</td>
</tr>
<tr>
<td>imports of a raster of 1.4 kB, 400,000 x 400,000</td>
<td>0.06</td>
<td>0</td>
<td>4 of 4</td>
<td>163</td>
<td>12</td>
<td>188</td>
</tr>
<tr>
<td>imports of 3 MB that unpack to 3 GB</td>
<td>0.04</td>
<td>0</td>
<td>4 of 4</td>
<td>165</td>
<td>12</td>
<td>187</td>
</tr>
<tr>
<td>a log of 3,000,000 rows</td>
<td>0.05</td>
<td>0</td>
<td>5 of 5</td>
<td>171</td>
<td>13</td>
<td>435</td>
</tr>
<tr>
<td>ten million particles</td>
<td>0.44</td>
<td>0</td>
<td>4 of 4</td>
<td>247</td>
<td>13</td>
<td>243</td>
</tr>
<tr>
<td>copies of one log</td>
<td>0.06</td>
<td>0</td>
<td>4 of 4</td>
<td>248</td>
<td>13</td>
<td>244</td>
</tr>
<tr>
<td>all at once</td>
<td>0.96</td>
<td>0</td>
<td>5 of 5</td>
<td>302</td>
<td>14</td>
<td>250</td>
</tr>
</tbody>
</table></div>
<p>Before there were bounds for them (12 s each, two cores, other work on the machine; the worst kind of request, s; the largest process, MB):</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>attack</th>
<th>p99</th>
<th>away for</th>
<th>API</th>
<th>database</th>
<th>worker</th>
</tr>
</thead>
<tbody>
<tr>
<td>nothing</td>
<td>0.13</td>
<td>0</td>
<td>134</td>
<td>11</td>
<td>284</td>
</tr>
<tr>
<td>a filter whose operands double 17 times</td>
<td>7.3 items</td>
<td>0</td>
<td>576</td>
<td>1022</td>
<td>286</td>
</tr>
<tr>
<td>40 bodies of which one byte comes</td>
<td>9.6 POST</td>
<td>11.9</td>
<td>294</td>
<td>11</td>
<td>288</td>
</tr>
<tr>
<td>210 connections with slow filters</td>
<td>9.8 items</td>
<td>14.5</td>
<td>619</td>
<td>1007</td>
<td>290</td>
</tr>
<tr>
<td>800 event streams</td>
<td>1.0 events</td>
<td>0</td>
<td>451</td>
<td>11</td>
<td>296</td>
</tr>
<tr>
<td>1,100 half requests</td>
<td>none answered</td>
<td>12.0 all, probes too</td>
<td>142</td>
<td>9</td>
<td>297</td>
</tr>
<tr>
<td>heads that never end</td>
<td>0.7</td>
<td>0</td>
<td>2623</td>
<td>13</td>
<td>304</td>
</tr>
<tr>
<td>imports of a raster of 1.4 kB, 400,000 x 400,000</td>
<td>0.1</td>
<td>0</td>
<td></td>
<td>12</td>
<td>2910</td>
</tr>
<tr>
<td>imports of 3 MB that unpack to 3 GB</td>
<td>0.1</td>
<td>0</td>
<td></td>
<td>12</td>
<td>4217</td>
</tr>
<tr>
<td>a log of 3,000,000 rows</td>
<td>0.2</td>
<td>0</td>
<td></td>
<td>13</td>
<td>399 while it is read</td>
</tr>
<tr>
<td>ten million particles</td>
<td>1.1 events</td>
<td>0, one of 4 drives done</td>
<td></td>
<td>13</td>
<td>16694</td>
</tr>
<tr>
<td>copies of one log</td>
<td>0.1</td>
<td>0, none of 4 done behind those</td>
<td></td>
<td>12</td>
<td></td>
</tr>
<tr>
<td>all at once</td>
<td>7.6 events</td>
<td>15.3 POST, 0 of 5 done</td>
<td>2861</td>
<td>864</td>
<td></td>
</tr>
</tbody>
</table></div>
`;export{e as default};