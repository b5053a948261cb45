// SPDX-License-Identifier: Apache-2.0
// Draws the parts of a report; everything else of the page stands without this script.
(function () {
  'use strict';
  var data = JSON.parse(document.getElementById('data').textContent);
  var byId = document.getElementById.bind(document);

  function floats(base64) {
    var text = atob(base64), bytes = new Uint8Array(text.length);
    for (var i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
    var view = new DataView(bytes.buffer), out = new Float32Array(bytes.length / 4);
    for (i = 0; i < out.length; ++i) out[i] = view.getFloat32(4 * i, true);
    return out;
  }

  // Blue inside, grey none, red outside: the same table as in scene.cc.
  var STOPS = [[5, 72, 145], [67, 147, 195], [158, 202, 225], [216, 216, 211], [246, 178, 138],
               [214, 96, 77], [150, 10, 38]];
  function paint(out, index, deviation, scale) {
    var at = 3 + 3 * Math.max(-1, Math.min(1, deviation / scale));
    var low = Math.max(0, Math.min(5, Math.floor(at))), part = at - low;
    for (var i = 0; i < 3; ++i) {
      out[3 * index + i] = ((1 - part) * STOPS[low][i] + part * STOPS[low + 1][i]) / 255;
    }
  }

  // ---- which part is shown -------------------------------------------------------------------
  // The last one, or report.html#part-6, by its number.
  var chosen = data.parts.length - 1, show = function () {};
  var asked = /^#part-(\d+)$/.exec(location.hash);
  document.querySelectorAll('.parts tr[data-number]').forEach(function (row) {
    if (asked && row.dataset.number === asked[1]) chosen = Number(row.dataset.part);
  });
  function choose(index) {
    chosen = index;
    // Head, rows and views: what is shown and printed is of one part.
    document.querySelectorAll('article.part, .head').forEach(function (piece) {
      piece.hidden = Number(piece.dataset.part) !== index;
    });
    document.querySelectorAll('.parts tr[data-part]').forEach(function (row) {
      var on = Number(row.dataset.part) === index;
      row.classList.toggle('chosen', on);
      row.querySelector('button').setAttribute('aria-pressed', on);
    });
    show();
  }
  document.querySelectorAll('.parts tr[data-part]').forEach(function (row) {
    row.addEventListener('click', function () { choose(Number(row.dataset.part)); });
  });

  // ---- lengths in inches ---------------------------------------------------------------------
  // One decimal more than in mm says hardly less, two more where there are few.
  function inInches(number, least) {
    return number.replace(/\d+(\.\d+)?/g, function (digits) {
      var decimals = (digits.split('.')[1] || '').length;
      decimals += decimals < 2 ? 2 : 1;
      return (Number(digits) / 25.4).toFixed(Math.max(decimals, least || 0));
    });
  }
  var lengths = [];
  function keep(element, converted) {
    lengths.push({element: element, mm: element.textContent, inch: converted});
  }
  document.querySelectorAll('tr[data-unit="mm"]').forEach(function (row) {
    row.querySelectorAll('td.n').forEach(function (cell) {
      keep(cell, inInches(cell.textContent));
    });
    var unit = row.querySelector('small');
    if (unit) keep(unit, 'in');
  });
  // Columns under a unit; those behind it without one are its uncertainty.
  document.querySelectorAll('.part table:not(.rows)').forEach(function (table) {
    var unit = '';
    table.querySelectorAll('thead th').forEach(function (head, column) {
      var small = head.querySelector('small');
      if (small) unit = small.textContent;
      else if (head.textContent !== '\u00b1') unit = '';
      if (unit !== 'mm') return;
      if (small) keep(small, 'in');
      table.querySelectorAll('tbody tr').forEach(function (row) {
        var cell = row.cells[column];
        if (cell && cell.className === 'n') keep(cell, inInches(cell.textContent));
      });
    });
  });
  document.querySelectorAll('.bar text').forEach(function (tick) {
    keep(tick, inInches(tick.textContent, 3).replace(' mm', ' in'));
  });
  // In sentences: "0.3 mm", "0.12 of 0.5 mm", "8.01 +- 0.02 mm", "1.00 mm, 1 sigma 0.007".
  var length = /(\d+(\.\d+)?( \+- | of ))*\d+(\.\d+)? mm\b(, 1 sigma \d+(\.\d+)?)?/g;
  document.querySelectorAll('.parts td, .part .cards, .head').forEach(function (piece) {
    var texts = document.createTreeWalker(piece, NodeFilter.SHOW_TEXT), text;
    while ((text = texts.nextNode())) {
      if (!text.data.match(length)) continue;
      keep(text, text.data.replace(length, function (found) {
        return found.split('1 sigma').map(function (part) {
          return inInches(part).replace(' mm', ' in');
        }).join('1 sigma');
      }));
    }
  });
  function showsInches() { return byId('unit').value === 'in'; }
  byId('unit').addEventListener('change', function () {
    lengths.forEach(function (each) {
      each.element.textContent = showsInches() ? each.inch : each.mm;
    });
  });

  // ---- the picture ---------------------------------------------------------------------------
  var renderer = null;
  try {
    renderer = new THREE.WebGLRenderer({antialias: true, alpha: true});
  } catch (error) {
    renderer = null;
  }
  if (!renderer || !data.parts.some(function (part) { return part.measured; })) {
    choose(chosen);
    return;
  }
  document.body.classList.remove('no-webgl');
  renderer.domElement.addEventListener('webglcontextlost', function () {
    document.body.classList.add('no-webgl');
  });

  var holder = byId('canvas'), labels = byId('labels'), readout = byId('readout');
  holder.appendChild(renderer.domElement);
  renderer.domElement.tabIndex = 0;
  renderer.domElement.setAttribute('aria-label', 'picture of the tube in three dimensions');
  renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
  var scene = new THREE.Scene();
  var camera = new THREE.PerspectiveCamera(32, 1, 1, 10000);
  camera.up.set(0, 0, 1);
  // Mostly even light, so that a colour means the same wherever it is on the tube.
  scene.add(new THREE.AmbientLight(0xffffff, 0.64));
  var lamp = new THREE.DirectionalLight(0xffffff, 0.38);
  camera.add(lamp);
  lamp.position.set(0.4, 0.8, 1);
  scene.add(camera);
  var controls = new THREE.OrbitControls(camera, renderer.domElement);
  // The wheel scrolls the page until the picture was touched.
  controls.enableZoom = false;
  ['pointerdown', 'touchstart'].forEach(function (name) {
    holder.addEventListener(name, function () { controls.enableZoom = true; }, true);
  });
  holder.addEventListener('mouseleave', function () { controls.enableZoom = false; });

  function faces(vertices, sides) {
    var rings = vertices / sides, index = [];
    for (var r = 0; r + 1 < rings; ++r) {
      for (var k = 0; k < sides; ++k) {
        var a = r * sides + k, b = r * sides + (k + 1) % sides;
        index.push(a, b, a + sides, b, b + sides, a + sides);
      }
    }
    return index;
  }
  function geometry(positions, sides) {
    var shape = new THREE.BufferGeometry();
    shape.setAttribute('position', new THREE.BufferAttribute(positions, 3));
    shape.setIndex(faces(positions.length / 3, sides));
    shape.computeVertexNormals();
    return shape;
  }

  function build(part) {
    var built = {measured: floats(part.measured), nominal: floats(part.nominal),
                 centers: floats(part.centers), deviation: floats(part.deviation), part: part};
    var tube = geometry(new Float32Array(built.measured), part.sides);
    var material = {side: THREE.DoubleSide, color: 0xffffff};
    if (part.compared) {
      tube.setAttribute('color',
        new THREE.BufferAttribute(new Float32Array(built.measured.length), 3));
      material.vertexColors = THREE.VertexColors;
    } else {
      material.color = 0x9fb2c1;
    }
    built.tube = new THREE.Mesh(tube, new THREE.MeshLambertMaterial(material));
    if (built.nominal.length) {
      built.ghost = new THREE.Mesh(geometry(built.nominal, part.sides),
        new THREE.MeshLambertMaterial({color: 0x7d8c98, transparent: true, opacity: 0.3,
          depthWrite: false, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 30}));
    }
    var raw = floats(part.points), count = raw.length / 4;
    var at = new Float32Array(3 * count);
    built.distance = new Float32Array(count);
    for (var i = 0; i < count; ++i) {
      at.set(raw.subarray(4 * i, 4 * i + 3), 3 * i);
      built.distance[i] = raw[4 * i + 3];
    }
    var cloud = new THREE.BufferGeometry();
    cloud.setAttribute('position', new THREE.BufferAttribute(at, 3));
    cloud.setAttribute('color', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
    built.cloud = new THREE.Points(cloud, new THREE.PointsMaterial(
      {size: 3, sizeAttenuation: false, vertexColors: THREE.VertexColors}));
    built.cloud.visible = count > 0;
    return built;
  }

  var cache = {}, current = null;
  // Draws deviations larger: both meshes correspond vertex by vertex.
  function exaggerate(built, factor) {
    var at = built.tube.geometry.getAttribute('position');
    for (var i = 0; i < built.measured.length; ++i) {
      at.array[i] = factor === 1 || !built.part.compared ? built.measured[i]
        : built.nominal[i] + factor * (built.measured[i] - built.nominal[i]);
    }
    at.needsUpdate = true;
    built.tube.geometry.computeVertexNormals();
    built.tube.geometry.computeBoundingSphere();
  }

  function addLabel(text, built, ring) {
    var element = document.createElement('span');
    element.textContent = text;
    labels.appendChild(element);
    built.labels.push({element: element, ring: ring});
  }
  function ringCenter(built, ring) {
    var at = built.tube.geometry.getAttribute('position').array, sides = built.part.sides;
    var sum = new THREE.Vector3();
    for (var k = 0; k < sides; ++k) {
      var v = 3 * (ring * sides + k);
      sum.x += at[v]; sum.y += at[v + 1]; sum.z += at[v + 2];
    }
    return sum.multiplyScalar(1 / sides);
  }
  function makeLabels(built) {
    labels.textContent = '';
    built.labels = [];
    var segments = built.part.segments;
    if (segments.length) addLabel('start', built, 0);
    for (var first = 0; first < segments.length; ++first) {
      var last = first;
      while (last + 1 < segments.length && segments[last + 1] === segments[first]) ++last;
      if (segments[first] % 2) {
        addLabel(String((segments[first] + 1) / 2), built, (first + last) >> 1);
      }
      first = last;
    }
  }
  function within(middle, size, room) {
    return Math.max(size / 2 + 2, Math.min(room - size / 2 - 2, middle)) + 'px';
  }
  function placeLabels() {
    if (!current) return;
    // Beside the tube, on the side away from the middle of the picture.
    var middle = controls.target.clone().project(camera);
    current.labels.forEach(function (label) {
      var p = ringCenter(current, label.ring).project(camera);
      var dx = p.x - middle.x, dy = p.y - middle.y, far = Math.hypot(dx, dy) || 1;
      var left = (p.x + 1) / 2 * holder.clientWidth + 30 * dx / far;
      var top = (1 - p.y) / 2 * holder.clientHeight - 30 * dy / far;
      // Whole, whatever the picture's edge would cut.
      label.element.style.left = within(left, label.element.offsetWidth, holder.clientWidth);
      label.element.style.top = within(top, label.element.offsetHeight, holder.clientHeight);
    });
  }

  var waitsForFrame = false;
  function draw() {
    if (waitsForFrame) return;
    waitsForFrame = true;
    requestAnimationFrame(function () {
      waitsForFrame = false;
      camera.updateMatrixWorld();
      renderer.render(scene, camera);
      placeLabels();
    });
  }

  function view(direction) {
    if (!current) return;
    var box = new THREE.Box3().setFromBufferAttribute(
      current.tube.geometry.getAttribute('position'));
    if (box.isEmpty()) return;
    var middle = box.getCenter(new THREE.Vector3());
    var radius = Math.max(1, box.getSize(new THREE.Vector3()).length() / 2);
    var at = current.tube.geometry.getAttribute('position').array, p = new THREE.Vector3();
    direction = direction.clone().normalize();
    var away = radius / Math.sin(camera.fov * Math.PI / 360);
    // Moves the camera until the tube fills the picture, leaving room for the labels.
    for (var round = 0; round < 4; ++round) {
      camera.position.copy(direction).multiplyScalar(away).add(middle);
      camera.lookAt(middle);
      camera.updateMatrixWorld();
      var most = 0;
      for (var i = 0; i < at.length; i += 3) {
        p.set(at[i], at[i + 1], at[i + 2]).project(camera);
        most = Math.max(most, Math.abs(p.x), Math.abs(p.y));
      }
      away *= most / 0.8;
    }
    camera.near = away / 100;
    camera.far = away * 20;
    camera.updateProjectionMatrix();
    controls.target.copy(middle);
    camera.position.copy(direction).normalize().multiplyScalar(away).add(middle);
    controls.update();
    draw();
  }
  // From where the tube looks largest: along its least extent, a little from the side and above.
  function reset() {
    var size = new THREE.Box3().setFromBufferAttribute(
      current.tube.geometry.getAttribute('position')).getSize(new THREE.Vector3());
    if (size.z < size.y * 0.6) view(new THREE.Vector3(0.35, -0.7, 1));
    else if (size.x < size.y * 0.6) view(new THREE.Vector3(1, -0.45, 0.5));
    else view(new THREE.Vector3(0.45, -1, 0.55));
  }

  function recolour(built, scale) {
    var tube = built.tube.geometry.getAttribute('color');
    if (tube) {
      for (var i = 0; i < built.deviation.length; ++i) {
        paint(tube.array, i, built.deviation[i], scale);
      }
      tube.needsUpdate = true;
    }
    var cloud = built.cloud.geometry.getAttribute('color');
    for (i = 0; i < built.distance.length; ++i) paint(cloud.array, i, built.distance[i], scale);
    cloud.needsUpdate = true;
  }

  function offer(id, on) { byId(id).closest('label').hidden = !on; }
  function apply() {
    offer('factor', current.part.compared);
    offer('ghost', Boolean(current.ghost));
    offer('scale', data.parts.length > 1);
    offer('mode', current.distance.length > 0);
    var own = byId('scale').value === 'own';
    recolour(current, own ? current.part.scale_mm : data.scale_mm);
    document.querySelectorAll('[data-bar]').forEach(function (bar) {
      bar.hidden = bar.dataset.bar !== (own ? String(chosen) : 'shared');
    });
    var factor = Number(byId('factor').value), mode = byId('mode').value;
    exaggerate(current, factor);
    current.tube.visible = mode !== 'points' || factor !== 1;
    // Scanned points have no partner on the nominal: they are only drawn where they were.
    current.cloud.visible = mode !== 'tube' && factor === 1;
    if (current.ghost) current.ghost.visible = byId('ghost').checked;
    draw();
  }
  show = function () {
    if (current) [current.tube, current.ghost, current.cloud].forEach(function (object) {
      if (object) scene.remove(object);
    });
    var first = !current;
    current = cache[chosen] = cache[chosen] || build(data.parts[chosen]);
    [current.tube, current.ghost, current.cloud].forEach(function (object) {
      if (object) scene.add(object);
    });
    makeLabels(current);
    apply();
    if (first) reset();
  };
  ['mode', 'factor', 'scale', 'ghost'].forEach(function (id) { byId(id).addEventListener('change', apply); });
  byId('reset').addEventListener('click', reset);
  document.querySelectorAll('[data-view]').forEach(function (button) {
    button.addEventListener('click', function () {
      // A little off the axis: straight down there is no up.
      view({x: new THREE.Vector3(1, 0, 0), y: new THREE.Vector3(0, -1, 0),
            z: new THREE.Vector3(0, -0.001, 1)}[button.dataset.view]);
    });
  });

  // ---- reading a deviation --------------------------------------------------------------------
  var ray = new THREE.Raycaster(), mouse = new THREE.Vector2(), waiting = false;
  holder.addEventListener('mousemove', function (event) {
    var box = holder.getBoundingClientRect();
    mouse.set((event.clientX - box.left) / box.width * 2 - 1,
              1 - (event.clientY - box.top) / box.height * 2);
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(function () {
      waiting = false;
      readout.textContent = read();
    });
  });
  function read() {
    if (!current || !current.tube.visible || !current.measured.length) return '';
    ray.setFromCamera(mouse, camera);
    var hit = ray.intersectObject(current.tube)[0];
    if (!hit) return '';
    var segment = current.part.segments[Math.floor(hit.face.a / current.part.sides)];
    var place = segment % 2 ? 'bend ' + (segment + 1) / 2 : 'straight ' + (segment / 2 + 1);
    if (!current.part.compared) return place;
    var value = current.deviation[hit.face.a];
    var size = Math.abs(value).toFixed(3);
    return place + ': ' + (value >= 0 ? '+' : '\u2212') +
      (showsInches() ? inInches(size) + ' in' : size + ' mm');
  }

  function resize() {
    if (!holder.clientWidth || !holder.clientHeight) return;
    renderer.setSize(holder.clientWidth, holder.clientHeight);
    camera.aspect = holder.clientWidth / holder.clientHeight;
    camera.updateProjectionMatrix();
    draw();
  }
  window.addEventListener('resize', resize);
  controls.addEventListener('change', draw);
  resize();
  choose(chosen);
})();
