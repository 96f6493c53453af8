# Shows a face of fapengine on a model in Godot 4: fapengine serve --sink ws-json://127.0.0.1:9200
# Put it on any node, choose the mesh that has the blend shapes, and the node of the head if it is to turn.
extends Node

@export var address := "ws://127.0.0.1:9200/"
@export var face: MeshInstance3D
@export var head: Node3D
## For models with the 15 visemes of Oculus instead of ARKit's shapes.
@export var visemes := false

var _socket := WebSocketPeer.new()
var _shapes := {}  # spelling without case and marks: number of the shape
var _head_at_rest := Basis.IDENTITY
var _wait_s := 0.0
var _was_open := false


func _ready() -> void:
	for number in face.get_blend_shape_count():
		_shapes[key(face.mesh.get_blend_shape_name(number))] = number
	if head:
		_head_at_rest = head.transform.basis
	_socket.connect_to_url(address)


func _process(delta: float) -> void:
	_socket.poll()
	match _socket.get_ready_state():
		WebSocketPeer.STATE_OPEN:
			_was_open = true
			var newest := ""
			while _socket.get_available_packet_count() > 0:  # only the last one counts
				newest = _socket.get_packet().get_string_from_utf8()
			if newest:
				_show(JSON.parse_string(newest))
		WebSocketPeer.STATE_CLOSED:
			if _was_open:
				_rest()
				_was_open = false
				_wait_s = 1.0
			_wait_s -= delta
			if _wait_s <= 0.0:
				_socket = WebSocketPeer.new()
				_socket.connect_to_url(address)
				_wait_s = 1.0


func _show(frame: Variant) -> void:
	if not frame is Dictionary:
		return
	var weights: Dictionary = frame["visemes" if visemes else "arkit"]
	for name in weights:
		var number: int = _shapes.get(key(name), -1)
		if number >= 0:
			face.set_blend_shape_value(number, weights[name])
	if head:  # degrees: down, the subject's left, right ear down; the model looks along +Z
		var turn: Array = frame["head"]
		var angles := Vector3(deg_to_rad(turn[0]), deg_to_rad(turn[1]), deg_to_rad(turn[2]))
		head.transform.basis = _head_at_rest * Basis.from_euler(angles)


func _rest() -> void:  # the server has gone: shut the mouth
	for number in _shapes.values():
		face.set_blend_shape_value(number, 0.0)
	if head:
		head.transform.basis = _head_at_rest


# Shapes go by many spellings: jawOpen, JawOpen, blendShape1.jawOpen, eyeBlink_L, viseme_PP.
static func key(name: String) -> String:
	var last := name.get_slice(".", name.get_slice_count(".") - 1)
	if last.ends_with("_L"):
		last = last.trim_suffix("_L") + "Left"
	elif last.ends_with("_R"):
		last = last.trim_suffix("_R") + "Right"
	return last.to_lower().replace("viseme_", "").replace("_", "")
