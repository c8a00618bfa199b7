// Bytes of the socket (docs/driving-protocol.md), little-endian.

const FRAME = 1;
const INPUT = 2;
const HEADER_BYTES = 20; // u8 type, u8 state, u16 rows, u32 tick, take, ack, extra_bytes
const STATE_BYTES = 8 * STATE_FIELDS.length;
const ROW_BYTES = 20;
const INPUT_BYTES = 28;
const RUN_STATES = ["paused", "running", "finished", "slow"]; // the values of a frame's byte `state`
const DEVICES = ["keyboard", "gamepad", "wheel", "touch", "script"]; // the values of an input's byte `device`
const CONTROL_STEP = 1e4; // the simulation rounds controls to a ten-thousandth (decision 006), so prediction does too

/** A frame as {state, tick, take, ack, own, rows, extra}; `own` is null for a receiver without a CAV. */
function decodeFrame(buffer) {
  const view = new DataView(buffer);
  const rows = view.getUint16(2, true);
  const extraBytes = view.getUint32(16, true);
  const extraAt = HEADER_BYTES + STATE_BYTES + rows * ROW_BYTES;
  if (view.getUint8(0) !== FRAME || buffer.byteLength !== extraAt + extraBytes) {
    throw new Error(`expected a frame of ${extraAt + extraBytes} bytes, found ${buffer.byteLength} bytes of type ${view.getUint8(0)}`);
  }
  return {
    state: RUN_STATES[view.getUint8(1)],
    tick: view.getUint32(4, true),
    take: view.getUint32(8, true),
    ack: view.getUint32(12, true),
    own: decodeOwnState(view, HEADER_BYTES),
    rows: Array.from({ length: rows }, (_, i) => decodeRow(view, HEADER_BYTES + STATE_BYTES + i * ROW_BYTES)),
    extra: extraBytes ? JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, extraAt))) : {},
  };
}

function decodeOwnState(view, offset) {
  const values = STATE_FIELDS.map((name, i) => [name, view.getFloat64(offset + 8 * i, true)]);
  return values.some(([, value]) => Number.isNaN(value)) ? null : Object.fromEntries(values);
}

/** A road user: x, y [m from the scene's origin], yaw [rad], speed [m/s]. */
function decodeRow(view, offset) {
  return {
    index: view.getUint16(offset, true),
    lamps: view.getUint8(offset + 2),
    flags: view.getUint8(offset + 3),
    x: view.getFloat32(offset + 4, true),
    y: view.getFloat32(offset + 8, true),
    yaw: view.getFloat32(offset + 12, true),
    speed: view.getFloat32(offset + 16, true),
  };
}

function encodeInput(device, number, time, control) {
  const view = new DataView(new ArrayBuffer(INPUT_BYTES));
  view.setUint8(0, INPUT);
  view.setUint8(1, DEVICES.indexOf(device));
  view.setUint32(4, number, true);
  view.setFloat64(8, time, true);
  view.setFloat32(16, control.throttle, true);
  view.setFloat32(20, control.brake, true);
  view.setFloat32(24, control.steer, true);
  return view.buffer;
}

/** The control that the simulation will use: within its limits, in whole ten-thousandths. */
function roundControl({ throttle, brake, steer }) {
  const round = (value, low) => Math.round(Math.min(1, Math.max(low, value || 0)) * CONTROL_STEP) / CONTROL_STEP;
  return { throttle: round(throttle, 0), brake: round(brake, 0), steer: round(steer, -1) };
}
