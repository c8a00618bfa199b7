({vehicle, delayMs, jitterMs, seconds, state, stall, tickMs}) => {
  // A server that ticks every `tickMs`, a browser that draws every 16 ms, and a network between them; time is made up.
  let seed = 7;
  const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
  const [prediction, clock] = [new Prediction(vehicle), new InputClock()];
  const [toServer, toPage, queue] = [[], [], []];
  const post = (box, now, what) => box.push({at: Math.max(now + delayMs + jitterMs * random(), box.at(-1)?.at ?? 0), what});
  let [body, used, ack, number, inputAt] = [state, {throttle: 0, brake: 0, steer: 0}, 0, 0, 0];
  const driven = (now) => ({throttle: now > 1000 ? 0.8 : 0, brake: 0, steer: now > 3000 ? 0.04 * Math.sin(now / 700) : 0});
  const [pictures, predicted, simulated] = [[], {}, {}];
  let repeated = 0;
  let mostWaiting = 0;
  const send = (now) => {
    const control = roundControl(driven(now));
    post(toServer, now, {number: ++number, control});
    prediction.apply(number, control);
    predicted[number] = prediction.head;
    inputAt = now;
  };
  for (let now = 0; now < 1000 * seconds; now += 2) {
    while (toServer.length && toServer[0].at <= now) queue.push(toServer.shift().what);
    if (now % tickMs === 0) {
      if (queue.length > 3) queue.splice(0, queue.length - 2);
      if (queue.length) ({control: used, number: ack} = queue.shift());
      else if (now > 1000) repeated += 1;
      body = stepVehicle(body, used, vehicle);
      simulated[ack] ??= body;
      post(toPage, now, {ack, body});
    }
    const isStalled = stall && now > stall[0] && now < stall[1];
    while (!isStalled && toPage.length && toPage[0].at <= now) {
      const frame = toPage.shift().what;
      prediction.acknowledge(frame.ack, frame.body);
      clock.noteFrame(now);
      if (clock.isDueByFrame(now, prediction.waiting, frame.ack)) send(now);
    }
    if (now % 16 === 0 && prediction.ready) {
      if (clock.isDueByTime(now)) send(now);
      prediction.advance(clock.ticksIn(now - inputAt), clock.ticksIn(16), 0.016);
      pictures.push({now, ...prediction.picture(driven(now))});
      mostWaiting = now > 1000 * seconds - 1000 ? Math.max(mostWaiting, prediction.waiting) : 0;
    }
  }
  return {pictures, predicted, simulated, repeated, mostWaiting};
}
