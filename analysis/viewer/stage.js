// The scene of three.js: objects of the run as meshes, camera, light.

const stage = {
    renderer: null, scene: null, camera: null, orbit: null, meshes: [], needsDrawing: true, size: [0, 0],

    // Fails where the browser has no WebGL.
    start(canvas) {
        this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
        this.scene = new THREE.Scene();
        this.camera = new THREE.PerspectiveCamera(35, 1, 0.01, 100);
        // From over the shoulder of the one who looks, so that all sides of a turntable are lit alike.
        const key = new THREE.DirectionalLight(0xffffff, 1.7);
        key.position.set(-0.6, 0.8, 0.6);
        this.camera.add(key, key.target);
        key.target.position.set(0, 0, -1);
        this.scene.add(this.camera, new THREE.HemisphereLight(0xffffff, 0x8a8a90, 1.6));
        this.orbit = new THREE.OrbitControls(this.camera, canvas);
        this.orbit.enableDamping = false;
        this.orbit.autoRotateSpeed = 3;
        this.orbit.addEventListener("change", () => (this.needsDrawing = true));
    },

    // Puts the objects of a run in place of those that are there.
    setObjects(objects, triangles) {
        for (const mesh of this.meshes) {
            this.scene.remove(mesh);
            mesh.geometry.dispose();
            mesh.material.dispose();
        }
        this.meshes = objects.map((object, i) => {
            const geometry = new THREE.BufferGeometry();
            geometry.setIndex(new THREE.BufferAttribute(triangles[i], 1));
            const isCloth = object.kind === "cloth";
            const material = new THREE.MeshLambertMaterial({ side: isCloth ? THREE.DoubleSide : THREE.FrontSide });
            // Cloth lies close on bodies: where the picture cannot tell them apart, cloth is in front.
            Object.assign(material, { polygonOffset: !isCloth, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
            const mesh = new THREE.Mesh(geometry, material);
            mesh.frustumCulled = false;
            mesh.visible = false;
            this.scene.add(mesh);
            return mesh;
        });
    },

    // Moves an object to these points and gives it colours: an array for its vertices, or one of red, green and blue up to 255.
    setFrame(index, points, colours) {
        const { geometry, material } = this.meshes[index];
        this.attribute(geometry, "position", points);
        this.attribute(geometry, "normal", normals(points, geometry.index.array));
        const isPainted = colours instanceof Float32Array;
        if (isPainted) this.attribute(geometry, "color", colours);
        if (material.vertexColors !== isPainted) {
            material.vertexColors = isPainted;
            material.needsUpdate = true;
        }
        material.color.set(isPainted ? "white" : rgb(colours));
        geometry.boundingSphere = null;
        this.meshes[index].visible = true;
        this.needsDrawing = true;
    },

    attribute(geometry, name, values) {
        const known = geometry.getAttribute(name);
        if (known && known.array.length === values.length) {
            known.array.set(values);
            known.needsUpdate = true;
        } else {
            geometry.setAttribute(name, new THREE.BufferAttribute(values.slice(), 3));
        }
    },

    // Shows all that is visible but the ground, from where it is seen now.
    fit(objects) {
        const pointsOf = (kinds) => {
            const shown = this.meshes.filter((mesh, i) => mesh.visible && kinds.includes(objects[i].kind));
            return shown.map((mesh) => mesh.geometry.getAttribute("position"));
        };
        const whole = box(pointsOf(["cloth", "body"])), middle = box(pointsOf(["cloth"]));
        if (!whole) return;
        // A body that is far larger than the cloth is scenery.
        const [low, high] = middle && whole.size > 4 * middle.size ? middle.ends : whole.ends;
        const centre = low.map((value, i) => (value + high[i]) / 2);
        const radius = Math.max(Math.hypot(...low.map((value, i) => high[i] - value)) / 2, 1e-6);
        const half = (this.camera.fov * Math.PI) / 360;
        const narrow = Math.min(half, Math.atan(Math.tan(half) * this.camera.aspect));
        const direction = this.camera.position.clone().sub(this.orbit.target);
        if (direction.length() < 1e-9 || !this.isFitted) direction.set(0.45, 0.25, 1);
        this.isFitted = true;
        this.orbit.target.set(...centre);
        this.camera.position.copy(this.orbit.target).addScaledVector(direction.normalize(), radius / Math.sin(narrow));
        Object.assign(this.camera, { near: radius / 100, far: radius * 100 });
        this.camera.updateProjectionMatrix();
        this.orbit.update();
        this.needsDrawing = true;
    },

    // Draws if anything has changed.
    draw(seconds) {
        const { clientWidth: width, clientHeight: height } = this.renderer.domElement.parentElement;
        if (width !== this.size[0] || height !== this.size[1]) {
            this.size = [width, height];
            this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
            this.renderer.setSize(width, height, false);
            this.camera.aspect = width / Math.max(height, 1);
            this.camera.updateProjectionMatrix();
            this.needsDrawing = true;
        }
        this.orbit.update(seconds);
        if (!this.needsDrawing) return;
        this.needsDrawing = false;
        this.renderer.setClearColor(getComputedStyle(document.body).backgroundColor);
        this.renderer.render(this.scene, this.camera);
    },

    // The vertex of cloth under a place of the canvas, in pixels of the page.
    vertexAt(x, y) {
        const place = new THREE.Vector2((2 * x) / this.size[0] - 1, 1 - (2 * y) / this.size[1]);
        const ray = new THREE.Raycaster();
        ray.setFromCamera(place, this.camera);
        const [hit] = ray.intersectObjects(this.meshes.filter((mesh) => mesh.visible), false);
        if (!hit) return null;
        const positions = hit.object.geometry.getAttribute("position");
        const distance = (v) => hit.point.distanceTo(new THREE.Vector3().fromBufferAttribute(positions, v));
        const corners = [hit.face.a, hit.face.b, hit.face.c].sort((a, b) => distance(a) - distance(b));
        return { object: this.meshes.indexOf(hit.object), vertex: corners[0] };
    },

    // The place on the canvas of a vertex, in pixels of the page.
    placeOf(index, vertex) {
        const point = new THREE.Vector3().fromBufferAttribute(this.meshes[index].geometry.getAttribute("position"), vertex);
        this.camera.updateMatrixWorld();
        point.project(this.camera);
        return [((point.x + 1) / 2) * this.size[0], ((1 - point.y) / 2) * this.size[1]];
    },

    // Red, green and blue of a pixel of the canvas, from 0 to 255.
    pixel(x, y) {
        this.needsDrawing = true;
        this.draw(0);
        const gl = this.renderer.getContext(), ratio = this.renderer.getPixelRatio(), read = new Uint8Array(4);
        gl.readPixels(Math.round(x * ratio), Math.round((this.size[1] - y) * ratio), 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, read);
        return [...read.subarray(0, 3)];
    },
};

// Normals of vertices: those of the triangles around each, by their areas.
function normals(points, triangles) {
    const sums = new Float32Array(points.length);
    for (let t = 0; t < triangles.length; t += 3) {
        const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
        const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
        const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
        const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
        for (const corner of [a, b, c]) {
            sums[corner] += x;
            sums[corner + 1] += y;
            sums[corner + 2] += z;
        }
    }
    for (let v = 0; v < sums.length; v += 3) {
        const length = Math.hypot(sums[v], sums[v + 1], sums[v + 2]) || 1;
        for (let i = 0; i < 3; i++) sums[v + i] /= length;
    }
    return sums;
}

// The box around all points of some attributes, and its diagonal; null where there is no point.
function box(attributes) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const { array } of attributes) {
        for (let i = 0; i < array.length; i++) {
            if (array[i] < low[i % 3]) low[i % 3] = array[i];
            if (array[i] > high[i % 3]) high[i % 3] = array[i];
        }
    }
    return low[0] <= high[0] ? { ends: [low, high], size: Math.hypot(...low.map((value, i) => high[i] - value)) } : null;
}
