var e=`<h1 id="the-particle-filters-answer-without-particles">The particle filter's answer without particles</h1>
<p><code>particle</code> takes <code>--option filter=ekf</code>: the extended Kalman filter of Al Assaad's background chapter (1.35)-(1.37) over the same nine states, the same
measurements, the same matching and terrain, the same slopes. It is deterministic, and gives what 100,000 particles give but for their sampling error, in less
than a fiftieth of their time. <code>filter=kf</code> is the Kalman filter (1.33)-(1.34), which may use only what is linear in the state: no pitch, no direction of
roads, the antenna's height over the ground as the predicted pitch has it. <code>filter=sir</code>, the thesis's particles, is the default.</p>
<h2 id="why-it-can-be"><a class="self" href="#why-it-can-be">Why it can be</a></h2>
<p>The model is linear and Gaussian but for pitch <code>atan(vz / |v|)</code>, heading <code>atan2(vy, vx)</code> and the antenna's lift <code>H / cos(pitch)</code>. At a vehicle's speed, with
velocity known to decimetres a second, all three are straight lines over the width of the posterior: the unscented filter, which sees curvature, and the
extended one differ by 0.0002 % of slope (rms over a drive), clouds of different seeds by 0.15 to 0.27 %. The map match is hard: it picks one road point
from the cloud's first two moments, and a Gaussian has these. There is nothing left for which the particles' freedom would be needed, so nothing to
Rao-Blackwellise either: with all of the state integrated out, one particle would remain.</p>
<h2 id="measured"><a class="self" href="#measured">Measured</a></h2>
<pre tabindex="0"><code>PYTHONPATH=.:benchmarks python -m particle.cheap_filter DATA_DIR --filters ekf --seeds 40 --filter-seeds 1      (accuracy)
PYTHONPATH=.:benchmarks python -m particle.cheap_filter DATA_DIR --seeds 2 --rounds 3                           (time)
</code></pre>
<p>Profile m8, 40 drives over each road, RMSE of segment slopes in percent and its standard deviation over the drives:</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>road</th>
<th>100,000 particles</th>
<th>extended filter</th>
<th>ratio of RMSE</th>
<th>ratio of spread</th>
</tr>
</thead>
<tbody>
<tr>
<td>09</td>
<td>0.839 (0.178)</td>
<td>0.830 (0.180)</td>
<td>0.99</td>
<td>1.02</td>
</tr>
<tr>
<td>10</td>
<td>0.885 (0.279)</td>
<td>0.868 (0.279)</td>
<td>0.98</td>
<td>1.00</td>
</tr>
<tr>
<td>town</td>
<td>0.627 (0.161)</td>
<td>0.608 (0.154)</td>
<td>0.97</td>
<td>0.96</td>
</tr>
</tbody>
</table></div>
<p>The cloud is a little worse for its sampling error, which another of its seeds shows: 0.15 % of slope here (rms). Within 1.96 sigma: 95, 96 and 99 % (particles
94, 95 and 99 %). With a phone's receiver and an outage of 30 s (10 drives) the ratios of RMSE are 0.97, 0.95 and 1.05, the cloud's own seed changes slopes
by 0.4 to 0.5 %, and the extended filter lies as near to the mean of four clouds as that mean's own error lets it (0.2 and 0.5 %). The Kalman filter, without
pitch, has 20 to 40 % more RMSE than the cloud (m8, six drives).</p>
<p>Time of the whole method after reading the log (epochs, mount, filter, slopes): 5 ms for drive 10 (134 epochs, 37 windows of terrain), 7 ms for drive 09 (178
epochs, 75 windows), 11 ms for 400 s of the town. The loop itself takes 5 microseconds an epoch; a window of terrain 45 for each segment matched, epochs and
mount together 1.3 ms a drive, slopes 37 microseconds each. Beside 100,000 particles in the same
run (3.6 ms an epoch there) the whole method was 75 (09), 79 (10) and 126 (town) times faster, the filter alone 136, 175 and 249 times.</p>
<h2 id="how-it-is-made"><a class="self" href="#how-it-is-made">How it is made</a></h2>
<p><code>fusion/published/particle/kalman_loop.py</code> is one compiled loop over the epochs, with the textbook's prediction and corrections by one number after another from
<code>fusion/filters/kalman.py</code>; it returns to Python only where it meets a segment whose terrain it does not know. <code>DriveRun</code> leads the engines that are not compiled
whole (cloud, unscented filter, odometers). Tests hold the loop equal to <code>DriveRun</code> with filters written from the textbook's functions and numerical
derivatives, to 1e-6 m and rad over whole drives: outages, wild fixes, pauses, missing sensors, every option.</p>
<p>On the way, what every method pays became cheaper: the mount's tilt by a recursion over epochs instead of a dense system (0.4 ms instead of up to 20; the
same to 1e-6), covariances of the line in compiled code.</p>
`;export{e as default};