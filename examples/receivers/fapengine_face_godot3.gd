# Shows a face of fapengine on a model in Godot 3: fapengine serve --sink ws-json://127.0.0.1:9200
# Put it on any node, choose the mesh that has the blend shapes, and the node of the head if it is to turn.
extends Node

export var address := "ws://127.0.0.1:9200/"
export(NodePath) var face_path
export(NodePath) var head_path
# For models with the 15 visemes of Oculus instead of ARKit's shapes.
export var visemes := false

var _socket := WebSocketClient.new()
var _shapes := {}  # spelling without case and marks: property of the shape
var _face: MeshInstance
var _head: Spatial
var _head_at_rest := Basis()
var _wait_s := 0.0
var _was_open := false


func _ready() -> void:
	_face = get_node(face_path)
	for number in _face.mesh.get_blend_shape_count():
		var name: String = _face.mesh.get_blend_shape_name(number)
		_shapes[key(name)] = "blend_shapes/" + name
	if head_path:
		_head = get_node(head_path)
		_head_at_rest = _head.transform.basis
	_socket.connect_to_url(address)


func _process(delta: float) -> void:
	_socket.poll()
	match _socket.get_connection_status():
		NetworkedMultiplayerPeer.CONNECTION_CONNECTED:
			_was_open = true
			var newest := ""
			while _socket.get_peer(1).get_available_packet_count() > 0:  # only the last one counts
				newest = _socket.get_peer(1).get_packet().get_string_from_utf8()
			if newest:
				_show(parse_json(newest))
		NetworkedMultiplayerPeer.CONNECTION_DISCONNECTED:
			if _was_open:
				_rest()
				_was_open = false
				_wait_s = 1.0
			_wait_s -= delta
			if _wait_s <= 0.0:
				_socket = WebSocketClient.new()
				_socket.connect_to_url(address)
				_wait_s = 1.0


func _show(frame) -> void:
	if not frame is Dictionary:
		return
	var weights: Dictionary = frame["visemes" if visemes else "arkit"]
	for name in weights:
		if _shapes.has(key(name)):
			_face.set(_shapes[key(name)], weights[name])
	if _head:  # degrees: down, the subject's left, right ear down; the model looks along +Z
		var turn: Array = frame["head"]
		var angles := Vector3(deg2rad(turn[0]), deg2rad(turn[1]), deg2rad(turn[2]))
		_head.transform.basis = _head_at_rest * Basis(angles)


func _rest() -> void:  # the server has gone: shut the mouth
	for property in _shapes.values():
		_face.set(property, 0.0)
	if _head:
		_head.transform.basis = _head_at_rest


# Shapes go by many spellings: jawOpen, JawOpen, blendShape1.jawOpen, eyeBlink_L, viseme_PP.
static func key(name: String) -> String:
	var parts := name.split(".")
	var last: String = parts[parts.size() - 1]
	if last.ends_with("_L"):
		last = last.trim_suffix("_L") + "Left"
	elif last.ends_with("_R"):
		last = last.trim_suffix("_R") + "Right"
	return last.to_lower().replace("viseme_", "").replace("_", "")
