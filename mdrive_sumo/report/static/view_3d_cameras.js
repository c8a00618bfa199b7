// Cameras of the 3-D view: pinholes with the poses of `sensing/camera/camera_model.py`.

const EYE = { x: 0.45, y: 0.37, z: 1.3 };
// [m] from the middle of the car: the left seat; 0.15 m above the mean eye height in cars (1.15 m, NCHRP report 400), because
// the model's bonnet is as high as its waist, and would cover the road up to 10 m ahead
const DRIVER_FOV_DEG = 75;
const CHASE = { behind: 11, above: 4.2, aim: 1.5, pitch: 12 * (Math.PI / 180), fov: 65, least: 4, gap: 0.5 };
const TOP = { fov: 40, height: 110 };
const MIRROR_FOV_DEG = 32;
const MIRRORS = {
  // place of the mirror on the car, direction (0: backwards, positive: turned to the left side), and rectangle on the canvas
  inside: { x: 0.5, y: 0.0, z: 1.3, turn: 0, rect: [0.38, 0.02, 0.24, 0.13], fov: 34 },
  left: { x: 0.75, y: 0.95, z: 0.98, turn: -0.14, rect: [0.015, 0.6, 0.17, 0.19], fov: MIRROR_FOV_DEG },
  right: { x: 0.75, y: -0.95, z: 0.98, turn: 0.14, rect: [0.815, 0.6, 0.17, 0.19], fov: MIRROR_FOV_DEG },
};

/** A picture: a camera and its rectangle of the canvas, as shares from its upper left corner. */
class ViewCamera {
  constructor() {
    this.camera = new THREE.PerspectiveCamera();
    this.camera.matrixAutoUpdate = false;
    this.rect = [0, 0, 1, 1];
    this.isMirror = false;
    this.hidesOwn = false;
    this.rays = new THREE.Matrix3();
  }

  /** Turns and places it: x, y, z [m], yaw [rad], pitch [rad, positive looks down], as `CameraMount` does. */
  aim(x, y, z, yaw, pitch = 0) {
    const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    const ahead = [cy * cp, sy * cp, -sp];
    const left = [-sy, cy, 0];
    const up = [cy * sp, sy * sp, cp];
    Object.assign(this, { x, y, z, ahead, left, up });
    this.camera.matrix.set(
      -left[0], up[0], -ahead[0], x,
      -left[1], up[1], -ahead[1], y,
      -left[2], up[2], -ahead[2], z,
      0, 0, 0, 1,
    );
    this.camera.matrixWorldNeedsUpdate = true;
    return this;
  }

  /** Sets the horizontal field of view [degrees] for a picture of a size [px]. */
  open(fovDeg, width, height, [near, far]) {
    const wide = Math.tan((fovDeg * Math.PI) / 360);
    const tall = (wide * height) / width;
    this.focalPx = width / 2 / wide;
    this.slope = Math.hypot(wide, tall);
    const flip = this.isMirror ? -1 : 1;
    this.camera.projectionMatrix.set(
      flip / wide, 0, 0, 0,
      0, 1 / tall, 0, 0,
      0, 0, -(far + near) / (far - near), (-2 * far * near) / (far - near),
      0, 0, -1, 0,
    );
    this.camera.projectionMatrixInverse.copy(this.camera.projectionMatrix).invert();
    const across = -flip * wide;
    const { ahead, left, up } = this;
    this.rays.set(
      ahead[0], across * left[0], tall * up[0],
      ahead[1], across * left[1], tall * up[1],
      ahead[2], across * left[2], tall * up[2],
    );
    return this;
  }

  distance({ x, y }) {
    return Math.hypot(x - this.x, y - this.y);
  }

  /** Whether something of a radius [m] on the ground may be in the picture. */
  mayShow({ x, y, radius }) {
    const [dx, dy] = [x - this.x, y - this.y];
    const depth = dx * this.ahead[0] + dy * this.ahead[1] - this.z * this.ahead[2];
    const around = radius + 4; // and its height
    if (depth < -around) return false;
    return Math.hypot(dx, dy, this.z) < (Math.max(depth, 0) + around) * Math.hypot(1, this.slope) + around;
  }
}

/** The horizontal field of view [degrees] of a picture that is wider than 16:9 and as high as one of 16:9. */
function widen(fovDeg, aspect) {
  const share = Math.max(1, (aspect * 9) / 16);
  return (360 / Math.PI) * Math.atan(share * Math.tan((fovDeg * Math.PI) / 360));
}

/** The pictures of a mode: cameras that follow a pose { x, y, yaw }. */
class CameraSet {
  constructor(scene, walls) {
    Object.assign(this, { scene, walls });
    this.main = new ViewCamera();
    this.four = scene.four.map(() => new ViewCamera());
    this.mirrors = Object.values(MIRRORS).map((mirror) => Object.assign(new ViewCamera(), { mirror, isMirror: true, isPlain: true, hidesOwn: true, rect: mirror.rect }));
  }

  /** Returns the pictures in the order of drawing; width and height of the canvas [px]. */
  arrange(look, width, height) {
    if (look.mode === "four") return this.arrangeFour(look, width, height);
    const { main } = this;
    main.hidesOwn = false;
    if (look.mode === "chase") this.chase(look);
    else if (look.mode === "top") this.lookDown(look);
    else this.sitDown(look);
    main.rect = [0, 0, 1, 1];
    main.open(widen(main.fov, width / height), width, height, this.scene.planes_m);
    return look.mode === "mirrors" ? [main, ...this.mirrors.map((camera) => this.turnBack(camera, look, width, height))] : [main];
  }

  mount(camera, { x, y, yaw }, place, turn = 0, pitch = 0) {
    const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
    return camera.aim(x + cos * place.x - sin * place.y, y + sin * place.x + cos * place.y, place.z, yaw + turn, pitch);
  }

  sitDown(look) {
    this.main.fov = look.fov ?? DRIVER_FOV_DEG;
    this.mount(this.main, look, EYE, look.glance ?? 0);
  }

  turnBack(camera, look, width, height) {
    const { mirror } = camera;
    this.mount(camera, look, mirror, Math.PI + mirror.turn);
    return camera.open(mirror.fov, mirror.rect[2] * width, mirror.rect[3] * height, this.scene.planes_m);
  }

  chase(look) {
    const { behind, above, aim, pitch, fov, least, gap } = CHASE;
    const yaw = look.yaw + (look.glance ?? 0);
    const [dx, dy] = [-behind * Math.cos(yaw), -behind * Math.sin(yaw)];
    const free = this.walls.findFree(look.x, look.y, look.x + dx, look.y + dy);
    const share = free < 1 ? Math.max(least, free * behind - gap) / behind : 1;
    this.main.fov = fov;
    this.main.aim(look.x + share * dx, look.y + share * dy, aim + (above - aim) * share, yaw, pitch);
  }

  lookDown(look) {
    this.main.fov = TOP.fov;
    this.main.aim(look.x, look.y, (look.height ?? TOP.height), look.north ? Math.PI / 2 : look.yaw, Math.PI / 2 - 1e-4);
  }

  arrangeFour(look, width, height) {
    return this.four.map((camera, i) => {
      camera.hidesOwn = camera.isPlain = true;
      camera.rect = [i % 2 ? 0.5 : 0, i < 2 ? 0 : 0.5, 0.5, 0.5];
      const rig = this.scene.four[i]; // the paper's cameras for people: front, rear, left, right
      this.mount(camera, look, rig, (rig.yaw_deg * Math.PI) / 180, (rig.pitch_deg * Math.PI) / 180);
      return camera.open(rig.fov_deg, width / 2, height / 2, this.scene.planes_m);
    });
  }
}
