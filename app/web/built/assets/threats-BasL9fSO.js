var e=`<h1 id="threats">Threats</h1>
<p>What somebody can try against a service, what happens, and what an operator has to see to. Every row was tried on a service as <code>versant up</code> starts it. How a well-behaved client is served meanwhile is measured by <code>PYTHONPATH=.:benchmarks python -m hostile</code>, figures <a href="#under-attack">below</a>.</p>
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
<td>a webhook is to call this machine or a private network, by a redirect or a name that changes</td>
<td>refused; the address that was checked is the one that is called, redirects are failures</td>
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
<td>a filter with nested brackets, long lists, many operators</td>
<td>400 that says the bound</td>
<td>32 brackets deep, 250 operators, 1,000 values</td>
<td><code>tests/app/map/items/test_refused_filters.py</code></td>
</tr>
<tr>
<td>an expensive search</td>
<td>400 after the time</td>
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
<td>another user of the machine reads logs, rasters or the database</td>
<td>folders of a data folder with its own database are 0700; PostgreSQL listens on a socket in one of them, and on no port</td>
<td></td>
<td><code>tests/app/cli/test_database.py</code></td>
</tr>
</tbody>
</table></div>
<p>Tried and harmless: methods that do not exist, TRACE and CONNECT (405); ranges by the thousand (the whole file); <code>X-Forwarded-Host</code> and <code>-Proto</code> (not taken for links); headers of language and of types by the thousand; two lengths in one request (400); websockets (an ordinary answer); <code>Last-Event-ID</code> of 60,000 digits; <code>..</code> in paths of pages,
signs and letters (404); 300 uploads that stand still (others go on, their parts go with them); <code>LIKE</code> with 2,000 wildcards; drawings by size (the size is fixed); thinning by <code>points=</code> beyond its bounds (422).</p>
<p>Open: drives are computed in the order in which they came, so a client who uploads hundreds of small logs is in front of the next one for as long as they take; rows of <code>audit</code> are kept for good; anybody who reaches the API may approve what another planned. Owners and keys will close these.</p>
<h2 id="under-attack"><a class="self" href="#under-attack">Under attack</a></h2>
<p><code>PYTHONPATH=.:benchmarks python -m hostile</code> starts a service with the usual limits (1,024 files a process) and attacks it in eleven ways, one after the other and all at once, while a client uploads a drive every four seconds and asks for eight other things four times a second. Good is: the 99th percentile of every kind of request below 2 s,
nothing answered by 503 (or not at all) for more than 5 s, no drive lost. Every attack comes from a loopback address of its own; with <code>--same-address</code> all come from the client's.</p>
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
<td>5724 (of those before, too)</td>
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