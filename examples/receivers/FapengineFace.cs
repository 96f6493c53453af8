// Shows a face of fapengine on a model in Unity: fapengine serve --sink ws-json://127.0.0.1:9200
// Put it on any object, choose the renderer that has the blend shapes, and the bone of the head if it is to turn.
using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Net.WebSockets;
using System.Text;
using System.Text.RegularExpressions;
using System.Threading;
using System.Threading.Tasks;
using UnityEngine;

public class FapengineFace : MonoBehaviour
{
    public string address = "ws://127.0.0.1:9200/";
    public SkinnedMeshRenderer face;
    public Transform head;
    [Tooltip("Largest weight of the model's shapes: 100 as a rule, 1 for some importers.")]
    public float fullWeight = 100f;
    [Tooltip("For models with the 15 visemes of Oculus instead of ARKit's shapes.")]
    public bool visemes;

    readonly CancellationTokenSource stop = new CancellationTokenSource();
    readonly Dictionary<string, int> shapes = new Dictionary<string, int>();
    Quaternion headAtRest = Quaternion.identity;
    string newest;   // written by the socket's task, shown by Update
    volatile bool isLost;

    void Start()
    {
        for (int i = 0; i < face.sharedMesh.blendShapeCount; i++)
            shapes[Key(face.sharedMesh.GetBlendShapeName(i))] = i;
        if (head != null) headAtRest = head.localRotation;
        Task.Run(Listen);
    }

    void OnDestroy() { stop.Cancel(); }

    void Update()
    {
        if (isLost) { isLost = false; Rest(); }
        string frame = Interlocked.Exchange(ref newest, null);
        if (frame == null) return;
        foreach (KeyValuePair<string, float> weight in Weights(frame, visemes ? "visemes" : "arkit"))
            if (shapes.TryGetValue(Key(weight.Key), out int shape))
                face.SetBlendShapeWeight(shape, fullWeight * weight.Value);
        Match turn = Regex.Match(frame, "\"head\": \\[([^,]+), ([^,]+), ([^\\]]+)\\]");
        if (head != null && turn.Success)   // degrees: down, the subject's left, right ear down
            head.localRotation = headAtRest * Quaternion.Euler(
                Number(turn.Groups[1].Value), -Number(turn.Groups[2].Value), -Number(turn.Groups[3].Value));
    }

    void Rest()   // the server has gone: shut the mouth
    {
        foreach (int shape in shapes.Values) face.SetBlendShapeWeight(shape, 0);
        if (head != null) head.localRotation = headAtRest;
    }

    async Task Listen()
    {
        var bytes = new byte[4096];
        while (!stop.IsCancellationRequested)
        {
            using (var socket = new ClientWebSocket())
            using (var text = new MemoryStream())
                try
                {
                    await socket.ConnectAsync(new Uri(address), stop.Token);
                    while (true)
                    {
                        var part = await socket.ReceiveAsync(new ArraySegment<byte>(bytes), stop.Token);
                        if (part.MessageType == WebSocketMessageType.Close) break;
                        text.Write(bytes, 0, part.Count);
                        if (!part.EndOfMessage) continue;
                        Interlocked.Exchange(ref newest, Encoding.UTF8.GetString(text.ToArray()));
                        text.SetLength(0);
                    }
                }
                catch (OperationCanceledException) { return; }
                catch (Exception error) when (error is WebSocketException || error is IOException) { }
            isLost = true;
            try { await Task.Delay(1000, stop.Token); } catch (OperationCanceledException) { return; }
        }
    }

    static IEnumerable<KeyValuePair<string, float>> Weights(string frame, string set)
    {
        Match inside = Regex.Match(frame, "\"" + set + "\": \\{([^}]*)\\}");
        foreach (Match one in Regex.Matches(inside.Groups[1].Value, "\"(\\w+)\": ([-+.eE0-9]+)"))
            yield return new KeyValuePair<string, float>(one.Groups[1].Value, Number(one.Groups[2].Value));
    }

    // Shapes go by many spellings: jawOpen, JawOpen, blendShape1.jawOpen, eyeBlink_L, viseme_PP.
    static string Key(string name)
    {
        string last = name.Substring(name.LastIndexOf('.') + 1);
        last = Regex.Replace(Regex.Replace(last, "_L$", "Left"), "_R$", "Right");
        return last.ToLowerInvariant().Replace("viseme_", "").Replace("_", "");
    }

    static float Number(string spelled) { return float.Parse(spelled, CultureInfo.InvariantCulture); }
}
